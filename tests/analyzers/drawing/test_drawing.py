"""Drawing: nothing is cut off, everything is where it says it is, and any text will do."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import combinations, pairwise
from pathlib import Path
from xml.etree import ElementTree as ET

import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from PIL import Image

from hrclog.analyzers import drawing
from hrclog.analyzers.drawing import shapes as drawing_shapes
from hrclog.analyzers.drawing.fonts import fitted_all, text_width
from hrclog.analyzers.drawing.layout import Layout, lay_out
from hrclog.analyzers.drawing.marks import Pen
from hrclog.analyzers.drawing.scale import Scale
from hrclog.analyzers.figures.palette import DARK, LIGHT, Color, diverging
from hrclog.analyzers.figures.plot import Axis, Band, ColorBar, Dot, Key, Plot, Rect, Stroke, Text
from hrclog.errors import OutputError

GARISH: Color = (255, 0, 254)
NAMES = ("place_orange_box_1", "pick_blue_cylinder", "screw", "inspect the weld seam/left")
SCRIPTS = (
    "拾取_大型零件",
    "مهمة الروبوت",
    "עבודה",
    "한국어",
    "$x^2_1$ <b>&amp;",
    "😀🦾",
    "a\nb\tc\x00",
    "\ud800\ufffe\uffff",
    "--",
    "é" + "\u0301" * 9,
)
LONG = tuple(f"move_the_large_component_number_{row:02d}_from_feeder_to_fixture_A" for row in range(40))

QUICK = settings(max_examples=20, deadline=None)


def matrix(names: Sequence[str], area: tuple[int, int] = (500, 300), *, on_top: bool = True) -> Plot:
    """Return a plot with a cell, a label and a text for each pair of names."""
    ticks = tuple((index + 0.5, name) for index, name in enumerate(names))
    cells = [(row, column) for row in range(len(names)) for column in range(len(names))]
    return Plot(
        ("matrix", "robot & <human>"),
        "Synergies",
        "Above 1 it takes longer.",
        Axis(0, len(names), "while the other is at", ticks),
        Axis(len(names), 0, "task", ticks),
        area,
        tuple(Rect((x, y), (x + 1, y + 1), diverging((x - y) / 4), f"{names[y]} / {names[x]}") for y, x in cells),
        texts=tuple(Text((x + 0.5, y + 0.5), f"{x - y:.2f}", "ink", room=0.9) for y, x in cells),
        keys=tuple(Key(name, GARISH, "dot", rim="ink") for name in names[:12]),
        color_bar=ColorBar(tuple(diverging(step / 10) for step in range(-10, 11)), ((0, "0.5 or less"), (1, "2")), "x"),
        names_on_top=on_top,
        notes=("One pair was never observed.",),
    )


def curves() -> Plot:
    """Return a plot with bands, strokes and dots."""
    xs = tuple(float(x) for x in range(1, 101))
    ys = [10 + 5 * math.sin(x / 9) for x in xs]
    return Plot(
        ("curves",),
        "Makespan",
        "Line: mean.",
        Axis(1, 100, "run", log=True, grid=True),
        Axis(0, 20, "makespan [s]", grid=True),
        (460, 300),
        bands=(Band(xs, tuple(y - 1 for y in ys), tuple(y + 1 for y in ys), (0, 114, 178)),),
        strokes=(
            Stroke(tuple(zip(xs, ys, strict=True)), (0, 114, 178), label="planner"),
            Stroke(((1, 5), (40, 9), (100, 2)), "muted", dashed=True, step=True),
        ),
        dots=(Dot((10, 10), 4, GARISH, "here"), Dot((20, 10), 6, GARISH, rim="ink")),
    )


def parsed(source: str) -> ET.Element:
    return ET.fromstring(source)  # noqa: S314 - our own output


def laid_out(plot: Plot, *, captions: bool = True) -> Layout:
    with drawing._settings():
        return lay_out(plot, captions=captions)


def written(layout: Layout) -> list[str]:
    with drawing._settings():
        return [label.text for label in (*layout.sheet.labels, *drawing_shapes.labels(layout.frame))]


def spots(pixels: np.ndarray, color: Color) -> np.ndarray:
    """Return the x and y of the middles of all pixels of a colour, shape (n, 2)."""
    return np.argwhere((pixels == color).all(axis=2))[:, ::-1] + 0.5


def has_free_border(pixels: np.ndarray, color: Color) -> bool:
    edges = (pixels[:4], pixels[-4:], pixels[:, :4], pixels[:, -4:])
    return all((edge == color).all() for edge in edges)


@pytest.mark.parametrize("on_top", [True, False])
@pytest.mark.parametrize("names", [NAMES, SCRIPTS, LONG, tuple(f"task_{n}" for n in range(60)), ()])
def test_nothing_is_cut_off(names: tuple[str, ...], on_top: bool) -> None:
    plot = matrix(names, on_top=on_top)
    assert has_free_border(drawing.pixels(plot).pixels, DARK["card"])
    assert has_free_border(drawing.pixels(plot, LIGHT).pixels, LIGHT["card"])


@QUICK
@given(st.lists(st.text(max_size=90), min_size=1, max_size=6), st.text(max_size=300), st.integers(20, 400))
@example(list(SCRIPTS), "".join(SCRIPTS), 60)
def test_any_text_is_drawn_within_the_picture(names: list[str], text: str, width: int) -> None:
    plot = replace(matrix(names, (width, 80)), title=text, reading=text, notes=(text,))
    plot = replace(
        plot, texts=(*plot.texts, Text((0, 0), text[:20], anchor="right"), Text((1, 0.5), text[:20], bold=True))
    )
    layout = laid_out(plot)
    assert all(
        0 <= left < right <= layout.width and 0 <= top < bottom <= layout.height
        for left, top, right, bottom in (label.bounds for label in layout.sheet.labels)
    )
    assert has_free_border(drawing.pixels(plot).pixels, DARK["card"])


@pytest.mark.parametrize("on_top", [True, False])
@pytest.mark.parametrize("count", [1, 3, 8, 40, 200])
@pytest.mark.parametrize("length", [1, 12, 60])
def test_no_two_texts_overlap(count: int, length: int, on_top: bool) -> None:
    names = [f"{index:_<{length}}" for index in range(count)]
    ticks = tuple((index + 0.5, name) for index, name in enumerate(names))
    plot = matrix(NAMES, (500, 300), on_top=on_top)
    plot = replace(
        plot, x=replace(plot.x, high=count, ticks=ticks), y=replace(plot.y, low=count, ticks=ticks), texts=()
    )
    labels = laid_out(plot).sheet.labels
    slanted = [label for label in labels if label.angle == 45]
    apart = [math.dist(one.at, other.at) / math.sqrt(2) - one.size for one, other in pairwise(slanted)]
    assert all(free > 0 for free in apart)
    upright = [label for label in labels if label not in slanted]
    for one, other in combinations(upright, 2):
        (left, top, right, bottom), (west, north, east, south) = one.bounds, other.bounds
        # bounds hold room between lines, which neighbours may share
        overlap = min(right - west, east - left), min(bottom - north, south - top)
        assert min(overlap) <= 0.16 * one.size, (one, other)


def test_names_that_are_shortened_are_told_apart_and_said_in_full() -> None:
    labels = [
        label for label in laid_out(matrix(LONG, (800, 800))).sheet.labels if label.angle == 0 and "…" in label.text
    ]
    assert len({label.text for label in labels if label.full in LONG}) == len(LONG)
    assert LONG[7] in [title.text for title in parsed(drawing.svg(matrix(LONG))).iter() if title.text]


@pytest.mark.parametrize("size", [9.0, 13.0])
def test_names_that_differ_where_all_are_cut_are_told_apart(size: float) -> None:
    names = [f"{'the_first_robot_' * 4}{number}{'_of_the_left_feeder' * 4}" for number in range(30)]
    shown = fitted_all([*names, names[0], "short"], size, 240)
    assert len(set(shown)) == len(names) + 1
    assert shown[0] == shown[-2]
    assert shown[-1] == "short"
    assert all(text_width(text, size) <= 240 for text in shown)


def test_names_are_drawn_within_a_room_too_narrow_to_tell_them_apart() -> None:
    shown = fitted_all(["a" * 30, "a" * 31], 13, 30)
    assert all(text_width(text, 13) <= 30 for text in shown)


def test_names_that_do_not_fit_are_counted() -> None:
    plot = replace(matrix([f"task_{n}" for n in range(100)], (300, 300)), rects=(), texts=())
    said = written(laid_out(plot))
    assert any(re.fullmatch(r"\d+ names at the axes do not fit\.", text) for text in said)


def test_an_axis_of_numbers_has_a_line_and_one_of_names_has_none() -> None:
    def lines(*names: str) -> int:
        ticks = tuple((index + 0.5, name) for index, name in enumerate(names))
        return len(laid_out(Plot(("x",), "X", "", Axis(0, 4, ticks=ticks), Axis(4, 0, ticks=ticks))).sheet.lines)

    assert lines("screw", "2") == 0
    assert lines("1", "-2.5", "1,000") == 2 * (1 + 3)


@pytest.mark.parametrize("captions", [True, False])
def test_the_area_has_the_size_that_was_asked_for(captions: bool) -> None:
    left, top, right, bottom = laid_out(matrix(NAMES, (517, 263)), captions=captions).frame.area
    assert (right - left, bottom - top) == (517, 263)


def test_plots_under_one_another_share_their_axis() -> None:
    plots = [replace(plot, left=200) for plot in (matrix(NAMES), curves(), matrix(LONG[:2]))]
    unlabelled = [replace(plot, y=replace(plot.y, label="")) for plot in plots]
    assert len({laid_out(plot).frame.area[0] for plot in unlabelled}) == 1


def test_captions_do_not_widen_a_picture() -> None:
    plot = matrix(NAMES)
    wordy = replace(plot, title="A title of words. " * 30, reading="To be read. " * 60, notes=("Not drawn. " * 60,) * 3)
    short, long = laid_out(plot), laid_out(wordy)
    assert long.width == short.width
    assert long.height > short.height + 200
    assert laid_out(wordy, captions=False).height == laid_out(plot, captions=False).height


@pytest.mark.parametrize("x", [Axis(0, 10), Axis(10, -3), Axis(0.5, 200, log=True), Axis(1e6, 1e6 + 1)])
@pytest.mark.parametrize("y", [Axis(-1, 1), Axis(1, -1), Axis(64, 0.001, log=True)])
def test_a_point_is_where_the_picture_says(x: Axis, y: Axis) -> None:
    for share in (0.1, 0.5, 0.83):
        point = tuple(
            axis.low * (axis.high / axis.low) ** share if axis.log else axis.low + share * (axis.high - axis.low)
            for axis in (x, y)
        )
        plot = Plot(("dot",), "Dot", "", x, y, (200, 100), dots=(Dot((point[0], point[1]), 5, GARISH),))
        picture = drawing.pixels(plot)
        found = spots(picture.pixels, GARISH)
        assert len(found) > 40
        assert (
            np.abs(found.mean(axis=0) - picture.at(plot, (point[0], point[1]))).max() <= 0.6
        )  # a lone dot moves to the nearest px
        assert picture.area[0] < picture.at(plot, (point[0], point[1]))[0] < picture.area[2]


def test_a_rectangle_covers_what_lies_between_its_corners() -> None:
    plot = replace(curves(), bands=(), strokes=(), dots=(), rects=(Rect((10, 15), (50, 5), GARISH),))
    picture = drawing.pixels(plot)
    found = spots(picture.pixels, GARISH)
    (left, bottom), (right, top) = picture.at(plot, (10, 5)), picture.at(plot, (50, 15))
    assert np.abs(found.min(axis=0) - (left, top)).max() <= 1
    assert np.abs(found.max(axis=0) - (right, bottom)).max() <= 1
    assert len(found) == np.prod(found.max(axis=0) - found.min(axis=0) + 1)


def test_a_moment_is_seen_and_what_is_beyond_the_axes_is_not() -> None:
    rects = (Rect((5, 1), (5, 2), GARISH), Rect((-5, 1), (-3, 2), (0, 255, 1)), Rect((9, 3), (99, 4), (0, 1, 255)))
    dots = (Dot((-1, 5), 5, (0, 255, 1)), Dot((math.nan, 5), 5, (0, 255, 1)))
    plot = Plot(("x",), "X", "", Axis(0, 10), Axis(0, 10), (100, 100), rects, dots=dots)
    plot = replace(plot, texts=(Text((11, 5), "outside"), Text((5, math.inf), "outside")))
    picture = drawing.pixels(plot)
    assert len(spots(picture.pixels, GARISH)) >= 9
    assert not len(spots(picture.pixels, (0, 255, 1)))
    assert spots(picture.pixels, (0, 1, 255))[:, 0].max() < picture.area[2]
    assert "outside" not in written(laid_out(plot))


def test_a_bar_from_zero_starts_at_the_end_of_a_logarithmic_axis() -> None:
    plot = replace(curves(), bands=(), strokes=(), dots=(), rects=(Rect((0, 5), (10, 15), GARISH),))
    picture = drawing.pixels(plot)
    assert spots(picture.pixels, GARISH)[:, 0].min() == picture.area[0] + 0.5


def test_a_long_line_has_no_gap() -> None:
    jump = 20_000
    points = tuple((float(x), float(x >= jump)) for x in range(2 * jump + 10))
    plot = Plot(("x",), "X", "", Axis(0, 2 * jump), Axis(-1, 2), (300, 90), strokes=(Stroke(points, GARISH, 3),))
    picture = drawing.pixels(plot)
    column = int(picture.at(plot, (jump, 0))[0])
    assert len(spots(picture.pixels[:, column - 1 : column + 2], GARISH)) > 29


def test_a_line_is_interrupted_where_it_has_no_value() -> None:
    points = ((0.0, 1.0), (4.0, 1.0), (4.5, math.nan), (5.5, math.nan), (6.0, 1.0), (10.0, 1.0))
    plot = Plot(("x",), "X", "", Axis(0, 10), Axis(0, 2), (300, 90), strokes=(Stroke(points, GARISH, 3),))
    picture = drawing.pixels(plot)
    columns = {int(x) for x in spots(picture.pixels, GARISH)[:, 0]}
    assert int(picture.at(plot, (2, 1))[0]) in columns
    assert int(picture.at(plot, (5, 1))[0]) not in columns
    xs = tuple(point[0] for point in points)
    banded = replace(plot, bands=(Band(xs, (0.5,) * 6, tuple(y for _, y in points), GARISH),))
    assert len(list(drawing_shapes.patches(laid_out(banded).frame))) == 2


def test_a_text_wider_than_its_room_is_left_out() -> None:
    texts = tuple(Text((5, 5), f"{room:g} is enough", room=room) for room in (1, 9))
    plot = Plot(("x",), "X", "", Axis(0, 10), Axis(0, 10), (200, 100), texts=texts)
    said = written(laid_out(plot))
    assert "9 is enough" in said
    assert "1 is enough" not in said


def test_a_plot_without_marks_says_so() -> None:
    plot = replace(curves(), bands=(), strokes=(), dots=())
    assert drawing_shapes.EMPTY in written(laid_out(plot))
    assert drawing_shapes.EMPTY in drawing.svg(plot)
    assert drawing_shapes.EMPTY not in written(laid_out(curves()))


@QUICK
@given(st.lists(st.text(max_size=40), min_size=1, max_size=4), st.text())
@example(list(SCRIPTS), "]]><script>--" + "".join(SCRIPTS))
def test_svg_is_well_formed_and_says_what_was_asked_for(names: list[str], text: str) -> None:
    plot = replace(matrix(names), title=text)
    root = parsed(drawing.svg(plot))
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    assert root.attrib["role"] == "img"
    assert root.attrib["viewBox"] == f"0 0 {root.attrib['width']} {root.attrib['height']}"
    assert root[0].tag.endswith("title")
    shown = {element.text for element in root.iter() if element.tag.endswith("text")}
    assert shown >= set(written(laid_out(plot, captions=False)))


@pytest.mark.parametrize("plot", [matrix(SCRIPTS), curves()])
def test_svg_holds_vectors_only_and_nothing_that_reaches_into_the_page(plot: Plot) -> None:
    drawn = drawing.svg(plot)
    for unwanted in ("<image", "<?xml", "<!DOCTYPE", "metadata", "<style", "matplotlib", "xlink", "ns0:"):
        assert unwanted not in drawn, unwanted
    assert "font-family=\"'DejaVu Sans', " in drawn
    assert drawn.count("font-family") == 1
    assert "sans-serif" in drawn


def test_names_within_svgs_of_one_page_are_their_own() -> None:
    wide = replace(curves(), area=(500, 300))
    drawn = [drawing.svg(plot) for plot in (curves(), wide, replace(wide, path=("other",)), matrix(NAMES))]
    for source in drawn:
        names = re.findall(r' id="([^"]*)"', source)
        assert set(names) == set(re.findall(r"url\(#([^)]*)\)", source)) | set(re.findall(r'href="#([^"]*)"', source))
    first, second = (set(re.findall(r' id="([^"]*)"', source)) for source in drawn[:2])
    assert first
    assert not first & second


def test_roles_become_variables_and_colours_stay() -> None:
    ink = (1, 2, 0)
    plot = replace(
        curves(), dots=(Dot((10, 10), 4, ink), Dot((11, 10), 4, "card", rim="unobserved")), keys=(Key("a", ink),)
    )
    drawn = drawing.svg(plot)
    for role in DARK:
        assert f"var(--{role})" in drawn
    assert "#010200" in drawn
    assert set(re.findall(r"#[0-9a-f]{6}", drawn)) == {"#010200", "#0072b2"}


def test_a_saved_svg_has_the_colours_of_paper(tmp_path: Path) -> None:
    drawing.save_svg(matrix(NAMES), tmp_path / "a.svg")
    source = (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert "var(" not in source
    assert "#{:02x}{:02x}{:02x}".format(*LIGHT["ink"]) in source


def test_marks_say_what_they_mean_up_to_a_limit() -> None:
    said = [title.text for title in parsed(drawing.svg(matrix(NAMES))).iter() if title.tag.endswith("title")]
    assert {f"{one} / {other}" for one in NAMES for other in NAMES} < set(said)
    many = matrix([str(n) for n in range(50)])
    assert drawing.svg(many).count("<title>") == 2001


def test_the_shape_under_the_pointer_lies_on_the_line() -> None:
    root = parsed(drawing.svg(curves()))
    (path,) = (
        element for element in root.iter() if element.find("{*}title") is not None and element.tag.endswith("path")
    )
    points = np.array([[float(number) for number in pair.split()] for pair in re.split("[ML]", path.attrib["d"])[1:]])
    line = drawing_shapes.traces(laid_out(curves(), captions=False).frame)[0].points
    assert np.abs(points[:, None] - line[None]).max(axis=2).min(axis=1).max() < 3


@pytest.mark.parametrize("plot", [matrix(NAMES), curves()])
def test_drawing_twice_gives_the_same(plot: Plot, tmp_path: Path) -> None:
    assert drawing.svg(plot) == drawing.svg(plot)
    assert (drawing.pixels(plot).pixels == drawing.pixels(plot).pixels).all()
    for name in ("one", "two"):
        drawing.save_png(plot, tmp_path / f"{name}.png")
        drawing.save_pdf([plot], tmp_path / f"{name}.pdf")
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()
    assert (tmp_path / "one.pdf").read_bytes() == (tmp_path / "two.pdf").read_bytes()


def test_threads_draw_as_one_does() -> None:
    plots = [curves(), matrix(NAMES)] * 4
    with ThreadPoolExecutor(4) as pool:
        drawn = list(pool.map(drawing.svg, plots))
    assert drawn == [drawing.svg(plot) for plot in plots]


def test_the_settings_of_the_user_neither_matter_nor_change() -> None:
    expected = drawing.svg(curves()), drawing.pixels(curves()).pixels
    with mpl.rc_context({"font.size": 30, "lines.linewidth": 9, "path.snap": False, "svg.fonttype": "path"}):
        before = dict(mpl.rcParams)
        assert drawing.svg(curves()) == expected[0]
        assert (drawing.pixels(curves()).pixels == expected[1]).all()
        assert dict(mpl.rcParams) == before


def test_a_pdf_has_a_page_for_each_plot_with_fonts_that_papers_take(tmp_path: Path) -> None:
    plots = [curves(), matrix(NAMES), curves()]
    drawing.save_pdf(plots, tmp_path / "a.pdf")
    content = (tmp_path / "a.pdf").read_bytes()
    assert len(re.findall(rb"/Type /Page\b", content)) == len(plots)
    assert b"/Subtype /Image" not in content
    assert b"/Type3" not in content
    assert b"/FontFile2" in content
    assert b"/ToUnicode" in content
    sizes = [tuple(map(float, box.split()[2:])) for box in re.findall(rb"/MediaBox \[([^]]*)\]", content)]
    layouts = [laid_out(plot) for plot in plots]
    assert sizes == [pytest.approx((layout.width * 0.75, layout.height * 0.75)) for layout in layouts]


def test_any_script_goes_into_a_pdf(tmp_path: Path) -> None:
    drawing.save_pdf([replace(matrix(SCRIPTS), title="".join(SCRIPTS))], tmp_path / "a.pdf")
    assert (tmp_path / "a.pdf").read_bytes().endswith(b"%%EOF\n")


def test_a_png_for_a_paper_has_300_dots_per_inch(tmp_path: Path) -> None:
    drawing.save_png(curves(), tmp_path / "a.png")
    with Image.open(tmp_path / "a.png") as image:
        layout = laid_out(curves(), captions=False)
        assert image.size == pytest.approx((layout.width * 300 / 96, layout.height * 300 / 96), abs=1)
        assert image.info["dpi"] == pytest.approx((300, 300), abs=0.1)


@pytest.mark.parametrize(
    "save", [drawing.save_png, drawing.save_svg, lambda plot, path: drawing.save_pdf([plot], path)]
)
def test_a_file_that_cannot_be_written_is_named(save: object, tmp_path: Path) -> None:
    (tmp_path / "taken").mkdir()
    assert callable(save)
    with pytest.raises(OutputError, match="taken: cannot be written"):
        save(curves(), tmp_path / "taken")


def test_many_marks_are_few_artists() -> None:
    with drawing._settings():
        layout = lay_out(replace(matrix([str(n) for n in range(40)]), texts=()), captions=False)
        pen = Pen(lambda _: (0, 0, 0), mpl.transforms.Affine2D(), 1)
        kinds = [type(artist).__name__ for artist in pen.artists(layout)]
    assert sum(kind != "_Line" for kind in kinds) < 10


@QUICK
@given(st.floats(-1e6, 1e6), st.floats(1e-3, 1e6), st.integers(40, 2000))
def test_numbers_on_a_linear_axis_are_round_and_evenly_apart(low: float, span: float, length: int) -> None:
    ticks = Scale(Axis(low, low + span), 0, length).ticks(80)
    values = [value for value, _ in ticks]
    assert all(low - span / 1e6 <= value <= low + span * (1 + 1e-6) for value in values)
    assert len(values) <= length / 80 * 1.6 + 2
    for step in np.diff(values):
        mantissa = step / 10 ** math.floor(math.log10(step) + 1e-6)
        assert min(abs(mantissa - nice) for nice in (1, 2, 5)) < 1e-3
    assert all(
        math.isclose(float(name.replace(",", "")), value, rel_tol=1e-9, abs_tol=span / 1e6) for value, name in ticks
    )
    assert not any("e" in name for _, name in ticks)


@pytest.mark.parametrize(
    ("low", "high", "names"),
    [
        (0.25, 4, "0.5 1 2"),
        (0.5, 10, "0.5 1 2 5 10"),
        (1, 1000, "1 2 5 10 20 50 100 200 500 1,000"),
        (0.9, 1.1, "0.90 0.95 1.00 1.05 1.10"),
        (0.001, 1e6, "0.001 0.01 0.1 1 10 100 1,000 10,000 100,000 1,000,000"),
    ],
)
def test_numbers_on_a_logarithmic_axis_are_written_plainly(low: float, high: float, names: str) -> None:
    assert " ".join(name for _, name in Scale(Axis(low, high, log=True), 0, 640).ticks(80)) == names
    assert [name for _, name in Scale(Axis(high, low, log=True), 0, 640).ticks(80)] == names.split()
