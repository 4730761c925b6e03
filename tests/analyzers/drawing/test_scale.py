"""Axes: whatever the ends, every value has its px and some values are named, in few characters."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hrclog.analyzers.drawing import svg
from hrclog.analyzers.drawing.layout import lay_out
from hrclog.analyzers.drawing.scale import Scale
from hrclog.analyzers.drawing.shapes import EMPTY, boxes
from hrclog.analyzers.figures.curves import MAX_CURVES, Curve, Knot, curves_plot, log_ticks
from hrclog.analyzers.figures.plot import Axis, Plot, Rect, Stroke
from hrclog.analyzers.figures.rows import Row, rows_plot, span

MOST = sys.float_info.max
LEAST = 5e-324
FINITE = st.floats(allow_nan=False, allow_infinity=False)
ABOVE_0 = st.floats(LEAST, MOST)


def check(axis: Axis, value: float, length: int = 640) -> None:
    """Fail unless an axis has a px for a value and its ends, and a few short names."""
    scale = Scale(axis, 0, length)
    assert np.isfinite(scale.at([axis.low, axis.high, value])).all()
    if axis.low != axis.high:
        assert scale.at([axis.low, axis.high]).tolist() == pytest.approx([0, length])
    ticks = scale.ticks(80)
    assert len(ticks) <= 1.6 * length / 80 + 2
    assert all(math.isfinite(at) for at, _ in ticks)
    assert all(0 < len(name) < 30 for _, name in ticks), ticks


@settings(max_examples=100, deadline=None)
@given(FINITE, FINITE, FINITE)
@example(-MOST, MOST, 0.0)
@example(MOST, MOST, MOST)
@example(0.0, LEAST, 1.0)
@example(0.0, 1e-300, 0.0)
@example(1e300, math.nextafter(1e300, math.inf), 0.0)
@example(1e16, 1e16, 0.0)
def test_any_ends_make_a_linear_axis(low: float, high: float, value: float) -> None:
    check(Axis(low, high), value)


@settings(max_examples=100, deadline=None)
@given(ABOVE_0, ABOVE_0, ABOVE_0)
@example(LEAST, MOST, 1.0)
@example(MOST, MOST, MOST)
@example(LEAST, 2 * LEAST, LEAST)
@example(1.0, MOST, 1.0)
def test_any_ends_above_0_make_a_logarithmic_axis(low: float, high: float, value: float) -> None:
    check(Axis(low, high, log=True), value)


def test_the_middle_of_the_widest_axis_is_its_middle() -> None:
    assert Scale(Axis(-MOST, MOST), 0, 640).at([0.0, MOST / 2]).tolist() == [320, 480]
    assert [name for _, name in Scale(Axis(-MOST, MOST), 0, 640).ticks(160)] == ["-1e+308", "0", "1e+308"]


def test_zero_is_short_on_an_axis_of_tiny_numbers() -> None:
    assert [name for _, name in Scale(Axis(0, 2e-290), 0, 160).ticks(80)] == ["0", "1e-290", "2e-290"]
    assert [name for _, name in Scale(Axis(0, 1), 0, 160).ticks(80)] == ["0.0", "0.5", "1.0"]


@pytest.mark.parametrize("ends", [(-MOST, MOST), (LEAST, LEAST), (0.0, LEAST)])
def test_a_line_between_any_ends_is_drawn(ends: tuple[float, float]) -> None:
    plot = Plot(
        ("x",), "X", "", Axis(0, 1), Axis(*ends, grid=True), strokes=(Stroke(((0, ends[0]), (1, ends[1])), "ink"),)
    )
    assert "<path" in svg(plot)


def test_a_bar_without_a_length_is_a_mark_of_1_px() -> None:
    bars = (Rect((2, 0.1), (2, 0.9), "ink"), Rect((0, 0.1), (0, 0.9), "ink"))
    for axis in (Axis(0, 4), Axis(-0.001, 0.001)):
        layout = lay_out(Plot(("x",), "X", "", axis, Axis(1, 0), rects=bars), captions=False)
        widths = [box.bounds[2] - box.bounds[0] for box in boxes(layout.frame)]
        assert widths == pytest.approx([1.0] * (2 if axis.high == 4 else 1))
        assert EMPTY not in [label.text for label in layout.sheet.labels]


@settings(max_examples=100, deadline=None)
@given(st.lists(FINITE, min_size=1, max_size=5), st.lists(FINITE, max_size=3))
@example([-MOST, MOST], [MOST])
@example([LEAST], [])
def test_a_span_holds_any_values_between_finite_ends(values: list[float], ends: list[float]) -> None:
    with np.errstate(all="ignore"):
        low, high = span(np.array(values), ends)
    assert -MOST <= low <= min(values)
    assert max(values) <= high <= MOST
    assert low < high or abs(low) == MOST


def test_a_sentinel_among_the_values_of_rows_is_left_out_and_said() -> None:
    rows = [Row("near", (1.0, MOST, 3.0), ("a", "b", "c")), Row("far", (-1e308,), ("a",))]
    plot = rows_plot(("rows",), "Rows", "Read.", rows, "metres", zero=True)
    assert [dot.at[0] for dot in plot.dots] == [1.0, 3.0, 2.0]
    assert [name for _, name in plot.y.ticks] == ["near (2)"]
    assert "Values beyond 1e12 that are left out, of the means too: 2." in plot.notes
    assert svg(plot)
    assert svg(rows_plot(("rows",), "Rows", "Read.", rows[1:], "metres"))


@settings(max_examples=30, deadline=None)
@given(st.lists(ABOVE_0, min_size=1, max_size=MAX_CURVES))
@example([LEAST, MOST])
@example([MOST])
@example([LEAST])
def test_curves_of_any_size_are_drawn(values: list[float]) -> None:
    curves = [Curve(f"c{index}", (Knot(5, value, value, value, ""),)) for index, value in enumerate(values)]
    plot = curves_plot(("curves",), "Curves", "Read.", curves, [5], "factor")
    assert 0 < plot.y.low < plot.y.high <= MOST
    assert 0 < len(plot.y.ticks) <= 12
    assert all(math.isfinite(text.at[1]) and text.at[1] > 0 for text in plot.texts)
    assert svg(plot)


@settings(max_examples=100, deadline=None)
@given(ABOVE_0, ABOVE_0)
@example(LEAST, 2 * LEAST)
def test_any_logarithmic_ticks_are_few(one: float, other: float) -> None:
    if one != other:
        low, high = sorted((one, other))
        assert len(log_ticks(low, high)) <= 12
