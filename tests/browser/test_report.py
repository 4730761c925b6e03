"""A report in a real browser: it is quiet, its controls work, it can be read in any light, and it prints."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Locator, Page, expect

from hrclog.analyzers.analysis import analyze
from hrclog.analyzers.figures.palette import DARK, LIGHT
from hrclog.analyzers.report import save_report
from hrclog.analyzers.report.document import Report
from hrclog.events import RunEnded, RunStarted, TaskEnded, TaskStarted
from hrclog.log.writing.writer import write_log

Open = Callable[..., Any]

pytestmark = pytest.mark.slow

SIZES = [(1600, 1000), (1000, 700), (400, 800)]
A4_PX = (688, 1032)
"""Px across an upright page, and across one on its side, between the margins."""

CONTRASTS = """
() => {
  const rgb = (text) => text.match(/[\\d.]+/g).map(Number);
  const luminance = (color) => {
    const linear = (part) => (part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4);
    const [r, g, b] = color.map((part) => linear(part / 255));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const ground = (element) => {
    for (let at = element; at; at = at.parentElement) {
      const color = rgb(getComputedStyle(at).backgroundColor);
      if (color.length === 3 || color[3] > 0) return color.slice(0, 3);
    }
    return [255, 255, 255];
  };
  const found = [];
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    const element = texts.currentNode.parentElement;
    if (!texts.currentNode.data.trim() || element.closest("svg, script") || !element.checkVisibility()) continue;
    const [a, b] = [rgb(getComputedStyle(element).color), ground(element)].map(luminance).sort((x, y) => y - x);
    found.push([(a + 0.05) / (b + 0.05), element.tagName, texts.currentNode.data.slice(0, 40)]);
  }
  return found;
}
"""
BEYOND = """
(width) => [...document.querySelectorAll("main *, nav *")]
  .filter((element) => !element.closest(".scroll > *") && element.checkVisibility())
  .filter((element) => element.getBoundingClientRect().right > width + 1)
  .map((element) => `${element.tagName} ${element.className} ${element.textContent.slice(0, 40)}`)
"""


def column(box: Locator, place: int) -> list[str]:
    return [text.strip() for text in box.locator(f"tbody td:nth-child({place})").all_inner_texts()]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_complains_of_nothing_and_asks_for_nothing(open_report: Open, path: Path, scheme: str) -> None:
    found = open_report(color_scheme=scheme)
    found.page.mouse.wheel(0, 100_000)
    for details in found.page.locator("summary").all():
        details.click()
    found.page.wait_for_load_state("networkidle")
    assert found.complaints == []
    assert found.requests == [path.as_uri()]


def test_tables_sort_by_value_with_the_unknown_last_both_ways(page: Page, numbers: list[float]) -> None:
    box = page.locator("#table-long")
    head = box.locator("th").nth(1)
    assert head.get_attribute("aria-sort") == "none"
    known = sorted(value for place, value in enumerate(numbers) if place % 50 != 3)
    head.get_by_role("button").click()
    assert head.get_attribute("aria-sort") == "ascending"
    assert column(box, 2) == [f"{value:,.3f}" for value in known[:200]]
    head.get_by_role("button").click()
    assert head.get_attribute("aria-sort") == "descending"
    assert [float(text) for text in column(box, 2)] == sorted(known, reverse=True)[:200]
    box.locator("input").fill("name")  # all but one, so still more than are shown
    box.locator("input").fill("3")
    shown = column(box, 2)
    unknown = [text == "n/a" for text in shown]
    assert unknown == sorted(unknown)
    assert any(unknown)
    values = [float(text) for text in shown if text != "n/a"]
    assert values == sorted(values, reverse=True)


def test_texts_sort_as_a_reader_expects_and_one_column_at_a_time(page: Page) -> None:
    box = page.locator("#table-synergies")
    first, second = box.locator("th").nth(1), box.locator("th").nth(4)
    second.get_by_role("button").click()
    first.get_by_role("button").click()
    assert second.get_attribute("aria-sort") == "none"
    tasks = column(box, 2)
    assert tasks == sorted(tasks)


def test_a_table_is_filtered_and_says_how_many_rows_are_left(page: Page) -> None:
    box = page.locator("#table-long")
    box.get_by_label("Filter").fill('NAME "24')
    assert [text for text in column(box, 1) if '"24' not in text] == []
    expect(box.locator("output")).to_have_text("11 of 250 rows")
    box.get_by_label("Filter").fill("hidden_part")  # in the middle of a name that is shown short
    assert len(column(box, 1)) == 1
    box.get_by_label("Filter").fill("")
    assert box.locator("tbody tr").count() == 200


def test_what_is_copied_is_all_rows_in_full_as_tab_separated_text(open_report: Open, numbers: list[float]) -> None:
    page = open_report(permissions=["clipboard-read", "clipboard-write"]).page
    box = page.locator("#table-long")
    box.get_by_role("button", name="Copy Long as tab-separated text").click()
    expect(box.locator("output")).to_have_text("250 rows copied")
    lines = page.evaluate("navigator.clipboard.readText()").split("\n")
    assert lines[0] == "name\tvalue_of_it"
    assert lines[1] == f"'=1+1·x\t{numbers[0]}"
    assert lines[4] == 'name "3", =x\t'
    assert len(lines) == 251
    synergies = page.locator("#table-synergies")
    synergies.locator(".copy").click()
    expect(synergies.locator("output")).to_contain_text("rows copied")
    header, *rows = [line.split("\t") for line in page.evaluate("navigator.clipboard.readText()").split("\n")]
    numbers = [row[header.index("synergy")] for row in rows]
    assert any(len(number) > 10 for number in numbers)


def test_the_csv_is_what_spreadsheets_read(page: Page, numbers: list[float], tmp_path: Path) -> None:
    with page.expect_download() as download:
        page.locator("#table-long .csv").click()
    assert download.value.suggested_filename == "table-long.csv"
    download.value.save_as(tmp_path / "long.csv")
    raw = (tmp_path / "long.csv").read_bytes().decode("utf-8-sig")
    lines = raw.split("\r\n")
    assert lines[1] == f"'=1+1·x,{numbers[0]}"
    assert lines[4] == '"name ""3"", =x",'
    assert len(lines) == 252


def test_the_slider_steps_through_what_grew_and_paper_shows_the_last(page: Page) -> None:
    figure = page.locator("#page-grown figure")
    slider = figure.get_by_role("slider", name="Runs taken in")
    visible, title = figure.locator(".stages .stage:visible"), figure.locator("h3 .stage:visible")
    assert visible.get_attribute("data-number") == "12"
    slider.focus()
    page.keyboard.press("ArrowLeft")
    assert visible.get_attribute("data-number") == "5"
    assert title.inner_text() == "After 5 runs"
    expect(figure.locator("output")).to_have_text("5 of 12")
    assert slider.get_attribute("aria-valuetext") == "5 of 12"
    page.emulate_media(media="print")
    assert visible.get_attribute("data-number") == "12"
    assert title.inner_text() == "After 12 runs"
    assert not slider.is_visible()


def test_without_javascript_everything_is_there_and_no_control_is_dead(open_report: Open, said: Report) -> None:
    page = open_report(java_script_enabled=False).page
    assert page.locator("figure svg:visible").count() >= len(said.figures)
    assert page.locator("#page-grown .stages .stage:visible").get_attribute("data-number") == "12"
    assert page.locator("button:visible, input:visible, output:visible").count() == 0
    assert page.locator("#table-long tbody tr:visible").count() == 200
    expect(page.locator("#table-long")).to_contain_text("200 of 250 rows are shown")


@pytest.mark.parametrize(("scheme", "theme"), [("light", LIGHT), ("dark", DARK)])
def test_text_can_be_read_in_both_themes(open_report: Open, scheme: str, theme: dict[str, object]) -> None:
    page = open_report(color_scheme=scheme).page
    for details in page.locator("summary").all():
        details.click()
    page.locator("#table-long th button").first.click()
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert ground == "rgb({}, {}, {})".format(*theme["card"])  # type: ignore[misc]  # a colour has three parts
    contrasts = page.evaluate(CONTRASTS)
    assert len(contrasts) > 500
    assert [found for found in contrasts if found[0] < 4.5] == []


def test_paper_is_light_whatever_the_screen_is(open_report: Open) -> None:
    page = open_report(color_scheme="dark").page
    page.emulate_media(media="print", color_scheme="dark")
    assert page.evaluate("getComputedStyle(document.body).color") == "rgb({}, {}, {})".format(*LIGHT["ink"])


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_the_page_never_scrolls_sideways(open_report: Open, size: tuple[int, int]) -> None:
    page = open_report(viewport={"width": size[0], "height": size[1]}).page
    for details in page.locator("summary").all():
        details.click()
    assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
    assert page.evaluate(BEYOND, size[0]) == []


def test_the_contents_stand_beside_the_report_where_there_is_room(open_report: Open) -> None:
    page = open_report(viewport={"width": 1600, "height": 1000}).page
    page.get_by_role("link", name="Methods and versions").click()
    page.wait_for_timeout(1000)
    expect(page.locator("#methods h2")).to_be_in_viewport()
    expect(page.get_by_role("link", name="Findings")).to_be_in_viewport()


def test_the_keyboard_reaches_what_works_and_what_scrolls_and_its_place_is_seen(open_report: Open) -> None:
    page = open_report(viewport={"width": 400, "height": 800}).page
    page.locator("#table-synergies .csv").focus()
    page.keyboard.press("Tab")
    focused = "document.activeElement"
    assert page.evaluate(f"{focused}.className") == "scroll"
    page.keyboard.press("Tab")
    assert page.evaluate(f"{focused}.closest('th').textContent") == "agent"
    assert page.evaluate(f"getComputedStyle({focused}).outlineStyle") == "solid"
    page.keyboard.press("Enter")
    assert page.locator("#table-synergies th").first.get_attribute("aria-sort") == "ascending"


def test_on_paper_every_figure_and_table_fits_the_page(open_report: Open) -> None:
    upright, sideways = A4_PX
    page = open_report(viewport={"width": sideways, "height": 1000}).page
    page.emulate_media(media="print")
    for width, boxes in ((sideways, "#tables table"), (upright, "figure, figure svg, section:not(#tables) table")):
        page.set_viewport_size({"width": width, "height": 1000})
        rights = [box.bounding_box() for box in page.locator(boxes).all() if box.is_visible()]
        assert rights
        assert [box for box in rights if box is not None and box["x"] + box["width"] > width + 1] == []
    assert page.locator("nav, .tools, #report button:visible >> nth=0").first.is_visible() is False


def test_printed_pages_tear_no_figure_repeat_heads_and_miss_no_section(
    open_report: Open, said: Report, tmp_path: Path
) -> None:
    if shutil.which("pdftotext") is None:
        pytest.skip("no pdftotext to read the printed pages (apt-get install poppler-utils)")
    page = open_report().page
    page.evaluate(
        "document.querySelectorAll('figure').forEach((one) => one.lastElementChild.append(`end of ${one.id}.`))"
    )
    page.pdf(path=str(tmp_path / "report.pdf"), prefer_css_page_size=True, print_background=True)
    printed = subprocess.run(
        ["pdftotext", "-layout", str(tmp_path / "report.pdf"), "-"], capture_output=True, check=True
    )
    pages = printed.stdout.decode().split("\f")
    text = " ".join(" ".join(pages).split())
    for name in (
        "Findings",
        *(section.name for section in said.sections),
        "Tables",
        "Single runs",
        "Methods and versions",
    ):
        assert name in text
    for number in range(1, len(said.figures) + 1):
        [begins] = [place for place, one in enumerate(pages) if re.search(rf"Figure {number}\b", one)]
        [ends] = [place for place, one in enumerate(pages) if f"end of figure-{number}." in " ".join(one.split())]
        assert begins == ends, f"figure {number}"
    heads = [one for one in pages if "value_of_it" in one]
    assert len(heads) == len([one for one in pages if 'name "' in one]) > 1


def test_names_in_logs_run_no_script(open_report: Open, tmp_path: Path) -> None:
    script = "<script>alert(1)</script><img src=https://example.invalid/x onerror=alert(2)>"
    attack = f"'\"></title></style></template>{script}"
    events = [RunStarted(time_ns=0, run_id="r", name=attack)]
    for side, agent in enumerate((attack, "x" * 200)):
        events.append(TaskStarted(time_ns=side, run_id="r", agent=agent, task=script, execution_id=f"e{side}"))
        events.append(TaskEnded(time_ns=10**9 + side, run_id="r", agent=agent, task=script, execution_id=f"e{side}"))
    events = sorted(events, key=lambda one: one.time_ns)
    write_log(tmp_path / "hostile.mcap", [*events, RunEnded(time_ns=2 * 10**9, run_id="r")])
    save_report(analyze(tmp_path / "hostile.mcap"), tmp_path / "report.html", title=attack)
    found = open_report(at=tmp_path / "report.html", viewport={"width": 400, "height": 800})
    for details in found.page.locator("summary").all():
        details.click()
    found.page.locator("#table-durations th button").first.click()
    found.page.wait_for_load_state("networkidle")
    assert found.complaints == []
    assert found.requests == [(tmp_path / "report.html").as_uri()]
    assert found.page.locator("img").count() == 0
    assert found.page.locator("script").count() == 1
    assert found.page.evaluate("document.documentElement.scrollWidth") <= 400
    assert script in found.page.locator("#table-durations tbody").inner_text().replace("\u200b", "")
