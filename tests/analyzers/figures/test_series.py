"""Numbers over time: no spike is lost, no sentinel flattens a line, and every line has a colour of its own."""

from __future__ import annotations

import math
import sys
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.analyzers.drawing import svg
from hrclog.analyzers.figures.gantt import Gantt
from hrclog.analyzers.figures.plot import Axis
from hrclog.analyzers.figures.series import SPEED_GROUP, Series, limits, signal_series, without_echoes
from hrclog.analyzers.figures.series_plot import MAX_LINES, series_plots
from hrclog.analyzers.figures.thinning import extremes
from hrclog.analyzers.projections.schemas import SIGNALS

S = 1_000_000_000
X = Axis(0, 10, "seconds")
QUICK = settings(max_examples=60, deadline=None)


def samples(name: str, values: list[float], step_ns: int = S) -> pl.DataFrame:
    rows = [("run", name, at * step_ns, value) for at, value in enumerate(values)]
    return pl.DataFrame(rows, schema=SIGNALS, orient="row")


def series(values: list[float], *, name: str = "gap", group: str = "signals", step: bool = False) -> Series:
    return Series(group, name, np.arange(len(values)) * S, np.array(values, np.float64), step)


@QUICK
@given(st.lists(st.floats(-1e9, 1e9) | st.just(math.nan), min_size=1, max_size=300), st.integers(4, 40))
def test_thinning_keeps_both_ends_and_the_extremes_in_order(values: list[float], most: int) -> None:
    (line,), captions = signal_series(samples("gap", values), 0, max_samples=most)
    assert len(line.values) <= most
    assert (np.diff(line.times_ns) > 0).all()
    assert (line.times_ns[0], line.times_ns[-1]) == (0, (len(values) - 1) * S)
    known = [value for value in values if not math.isnan(value)]
    assert not known or (np.nanmin(line.values), np.nanmax(line.values)) == (min(known), max(known))
    assert line.thinned == (len(values) > most)
    assert captions == (["1 signal is thinned to its lowest and highest values."] if line.thinned else [])


@pytest.mark.parametrize("at", [1, 17_777, 59_999, 99_998])
def test_a_spike_of_one_sample_survives_in_the_recording_and_in_the_report(at: int) -> None:
    values = [1.0] * 100_000
    values[at] = 0.01
    found, _ = signal_series(samples("robot/min_distance", values), 0)
    (plot,) = series_plots(found, X, ("run",))
    assert 0.01 in found[0].values
    assert 0.01 in [y for _, y in plot.strokes[0].points]
    assert plot.notes == ("1 signal is thinned to its lowest and highest values.",)


def test_few_samples_are_all_kept() -> None:
    assert extremes(np.array([1.0, 1.0, 2.0]), 4).tolist() == [0, 1, 2]


@pytest.mark.parametrize("sentinel", [sys.float_info.max, -sys.float_info.max, 1e308, 1e12, math.inf])
def test_a_sentinel_is_not_drawn_and_said(sentinel: float) -> None:
    found, captions = signal_series(samples("robot/min_distance", [1.0, sentinel, 0.5, sentinel, sentinel]), 0)
    (plot,) = series_plots(found, X, ("run",))
    said = "3 samples of robot/min_distance beyond 1e12 are not drawn."
    assert found[0].values.tolist() == [1.0, 0.5]
    assert captions == [said]
    assert plot.notes == (said,)
    assert plot.y.high < 2
    assert svg(plot)


def test_a_signal_of_sentinels_alone_leaves_a_plot_that_says_so() -> None:
    found, _ = signal_series(samples("gap", [1e300]), 0)
    (plot,) = series_plots(found, X, ("run",))
    assert (plot.strokes, plot.notes) == ((), ("1 sample of gap beyond 1e12 is not drawn.",))
    assert "nothing observed" in svg(plot)


@pytest.mark.parametrize("values", [[5e-324], [0.0, 5e-324], [-5e-324, 5e-324], [9e11, -9e11], [math.nan], [0.0]])
def test_values_of_any_size_are_drawn(values: list[float]) -> None:
    found, _ = signal_series(samples("gap", values), 0)
    (plot,) = series_plots(found, X, ("run",))
    assert svg(plot)


@pytest.mark.parametrize(
    ("values", "ends"),
    [
        ([0.2, 0.8], (0, 1)),
        ([100.0, 35.0], (0, 100)),
        ([], (0, 1)),
        ([-1.0, 0.5], (-1, 0.5)),
        ([math.nan], (0, 1)),
        ([-2.0], (-2, 0)),
    ],
)
def test_a_held_share_has_an_axis_from_0_to_1_and_others_reach_their_values(
    values: list[float], ends: tuple[float, float]
) -> None:
    assert limits([series(values, step=True)]) == ends


def test_a_speed_scale_in_percent_lies_within_its_axis_in_both_pictures() -> None:
    from hrclog.analyzers.rerun.layout import _series_view

    found, _ = signal_series(samples("robot/speed_scale", [100.0, 35.0]), 0)
    (plot,) = series_plots(found, X, ("run",))
    assert plot.y.low <= 0
    assert plot.y.high >= 100
    for values, ends in (([100.0, 35.0], (-5, 105)), ([0.2, 1.0], (-0.05, 1.05))):
        view = _series_view(Gantt((), 0, S, ()), SPEED_GROUP, [series(values, group=SPEED_GROUP, step=True)])
        (shown,) = view.properties["ScalarAxis"].range.as_arrow_array().to_pylist()
        assert shown == pytest.approx(ends)


@pytest.mark.parametrize("count", [1, MAX_LINES, MAX_LINES + 1, 24])
def test_every_line_of_a_plot_has_a_colour_of_its_own(count: int) -> None:
    lines = [series([0.0, 1.0], name=f"s{index}") for index in range(count)]
    plots = series_plots(lines, X, ("run",))
    assert [stroke.label for plot in plots for stroke in plot.strokes] == [one.name for one in lines]
    assert len({plot.path for plot in plots}) == len(plots) == -(-count // MAX_LINES)
    assert {plot.x for plot in plots} == {X}
    for plot in plots:
        assert len({stroke.paint for stroke in plot.strokes}) == len(plot.strokes) == len(plot.keys) <= MAX_LINES
    titles = [plot.title for plot in plots]
    assert titles == (
        ["Signals"]
        if len(plots) == 1
        else [f"Signals ({number} of {len(plots)})" for number in range(1, len(plots) + 1)]
    )


def told(values: list[float]) -> Series:
    return series(values, name="robot", group=SPEED_GROUP, step=True)


def logged(values: list[float], late_ns: int = 0) -> Series:
    found = series(values, name="robot, as a signal", group=SPEED_GROUP, step=True)
    return replace(found, times_ns=found.times_ns + late_ns)


@pytest.mark.parametrize(
    ("signal", "kept"),
    [
        (logged([1.0, 0.5, 0.5, 0.0], S // 2), False),
        (logged([1.0, 0.515, 0.5, 0.0], S // 2), False),  # nearly the same
        (logged([1.0, 1.0, 0.5, 0.5], S // 10), False),  # a moment later
        (logged([1.0, 0.6, 0.5, 0.0], S // 2), True),
        (logged([100.0, 50.0, 50.0, 0.0], S // 2), True),
        (logged([1.0, 0.5, math.nan, 0.0], S // 2), False),
        (logged([math.nan] * 4), True),
        (logged([1.0, 1.0], -3 * S), False),  # full speed before the first event
        (logged([0.5, 1.0], -3 * S), True),
    ],
)
def test_a_speed_scale_that_the_events_tell_too_is_drawn_once(signal: Series, *, kept: bool) -> None:
    events, other = told([1.0, 0.5, 0.5, 0.0, 0.0]), series([1.0, 0.5])
    assert without_echoes([events, signal, other]) == ([events, signal, other] if kept else [events, other])
    assert without_echoes([signal]) == [signal]
