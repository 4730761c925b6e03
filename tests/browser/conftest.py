"""A real browser without a window, and reports to open in it."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from hrclog.analyzers.analysis import analyze
from hrclog.analyzers.figures.plot import Axis, Plot, Stroke
from hrclog.analyzers.figures.table import DataTable
from hrclog.analyzers.report.document import Figure, Report, Section, report
from hrclog.analyzers.report.finding import Finding
from hrclog.analyzers.report.methods import Remark
from hrclog.analyzers.report.save import write_report
from hrclog.analyzers.report.tables import page_table

SAMPLES = Path(__file__).parents[2] / "sample_logs"
PROGRAMS = ("chromium", "chromium-browser", "google-chrome")
NUMBERS = [float((place * 37) % 250) - 100.5 for place in range(250)]


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    program = next(filter(None, map(shutil.which, PROGRAMS)), None)
    if program is None:
        pytest.skip(f"no browser: none of {', '.join(PROGRAMS)} is installed (apt-get install chromium)")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program)
        yield browser
        browser.close()


def with_more(said: Report) -> Report:
    """Return a report with a figure that grew with the runs, a long table with unknown numbers, and lost data."""
    stages = tuple((number, _grown(number)) for number in (2, 5, 12))
    number = len(said.figures) + 1
    section = Section("page-grown", "Grown", (Figure(number, stages[-1][1], stages),))
    values = [None if place % 50 == 3 else value for place, value in enumerate(NUMBERS)]
    names = [f'name "{place}", =x' if place else "=1+1\tx" for place in range(len(values))]
    names[9] = f"long_{'_' * 40}hidden_part{'_' * 40}"
    frame = pl.DataFrame({"name": names, "value_of_it": values})
    table = page_table(DataTable("long", "Long", frame, "A long one."), "table-long")
    return replace(
        said,
        findings=(Finding("Data was lost.", kind="lost"), *said.findings),
        sections=(*said.sections, section),
        tables=(*said.tables, table),
        remarks=(Remark("error", "truncated", 1, "the file ends inside a record"), *said.remarks),
    )


def _grown(number: int) -> Plot:
    line = Stroke(((0.0, 0.0), (1.0, number / 12)), (0, 114, 178))
    return Plot(("grown",), f"After {number} runs", "A line.", Axis(0, 1), Axis(0, 1), strokes=(line,))


@pytest.fixture(scope="session")
def said() -> Report:
    return with_more(report(analyze([SAMPLES / "campaign", SAMPLES / "failures.mcap"]), runs=2))


@pytest.fixture(scope="session")
def path(said: Report, tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("report") / "report.html"
    write_report(said, found)
    return found


@dataclass
class Opened:
    """A page, what it complained of, and what it asked for."""

    page: Page
    complaints: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)


@pytest.fixture
def open_report(browser: Browser, path: Path) -> Iterator[Callable[..., Opened]]:
    """Return how to open a report: `open_report(at=path, **settings of the browser's context)`."""
    contexts = []

    def call(*, at: Path = path, **settings: Any) -> Opened:  # noqa: ANN401 - whatever a context takes
        context = browser.new_context(**settings)
        contexts.append(context)
        found = Opened(context.new_page())
        found.page.on("console", lambda message: found.complaints.append(f"{message.type}: {message.text}"))
        found.page.on("pageerror", lambda error: found.complaints.append(f"error: {error}"))
        found.page.on("request", lambda request: found.requests.append(request.url))
        found.page.goto(at.as_uri())
        return found

    yield call
    for context in contexts:
        context.close()


@pytest.fixture
def page(open_report: Callable[..., Opened]) -> Page:
    return open_report(viewport={"width": 1600, "height": 1000}).page


@pytest.fixture
def numbers() -> list[float]:
    """Return the numbers of the long table, before some of them are taken for not known."""
    return NUMBERS
