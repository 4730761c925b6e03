"""A wrong frame ends in one sentence: what was found, what was expected, which columns are amiss, what to do."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import event_frames
import interval_frames
import numpy as np
import polars as pl
import pytest

import hrclog
from hrclog.analyzers.projections.frames import EVENTS_FRAME, INTERVALS_FRAME, SIGNALS_FRAME, Kind, check_frame
from hrclog.analyzers.projections.schemas import SIGNALS
from hrclog.errors import FrameError

EVENTS = event_frames.frame([event_frames.event("task_started", 0), event_frames.event("task_ended", 1)])
INTERVALS = interval_frames.frame([interval_frames.row("A", "x", 0, 1)])

OF_INTERVALS = {"overlaps": hrclog.overlaps, "durations": hrclog.durations, "metrics": hrclog.metrics}
CALLS: dict[str, tuple[Callable[[Any], object], Kind]] = {
    "intervals": (hrclog.intervals, EVENTS_FRAME),
    **{name: (function, INTERVALS_FRAME) for name, function in OF_INTERVALS.items()},
    "metrics(events)": (lambda frame: hrclog.metrics(INTERVALS, events=frame), EVENTS_FRAME),
    "metrics(signals)": (lambda frame: hrclog.metrics(INTERVALS, signals=frame), SIGNALS_FRAME),
}
OPTIONAL = ("metrics(events)", "metrics(signals)")


class PandasFrame:
    """Stands for a pandas frame, which the tests do without."""


PandasFrame.__module__ = "pandas.core.frame"
PandasFrame.__qualname__ = "DataFrame"

NO_FRAMES: dict[str, tuple[object, str]] = {
    "text": ("runs/monday.mcap", r"found the path 'runs/monday\.mcap'"),
    "path": (Path("monday.mcap"), r"found the path 'monday\.mcap'"),
    "paths": (["a.mcap"], "found a list"),
    "pandas": (PandasFrame(), r"found a pandas DataFrame.*polars\.from_pandas\(frame\)"),
    "numpy": (np.zeros(3), "found a numpy ndarray"),
    "lazy": (INTERVALS.lazy(), r"found a polars LazyFrame.*collect\(\)"),
    "arrow": (INTERVALS.to_arrow(), r"found a pyarrow Table.*polars\.from_arrow\(table\)"),
    "none": (None, "found None"),
}


def refusal(call: str, frame: object) -> str:
    with pytest.raises(FrameError) as raised:
        CALLS[call][0](frame)
    assert isinstance(raised.value, hrclog.HrclogError)
    return str(raised.value)


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("name", NO_FRAMES)
def test_what_is_no_frame_is_called_what_it_is(call: str, name: str) -> None:
    if name == "none" and call in OPTIONAL:
        return
    value, text = NO_FRAMES[name]
    with pytest.raises(FrameError, match=text) as raised:
        CALLS[call][0](value)
    kind = CALLS[call][1]
    assert f"expected a polars frame of {kind.name} (schema {kind.defined_as})" in str(raised.value)


@pytest.mark.parametrize("call", CALLS)
def test_the_remedy_is_the_call_that_makes_the_frame(call: str) -> None:
    assert refusal(call, "a.mcap").endswith(f"; {CALLS[call][1].made_by} makes one")


@pytest.mark.parametrize("call", OF_INTERVALS)
def test_events_where_intervals_are_expected(call: str) -> None:
    text = refusal(call, EVENTS)
    assert text.startswith("found a frame of events, without the columns ")
    assert "start_ns, end_ns, until_ns" in text
    assert "hrclog.intervals(events)" in text


@pytest.mark.parametrize("call", ["intervals", "metrics(events)"])
def test_intervals_where_events_are_expected(call: str) -> None:
    text = refusal(call, INTERVALS)
    assert text.startswith("found a frame of intervals, without the columns ")
    assert "kind" in text
    assert "hrclog.read_events(paths)" in text


@pytest.mark.parametrize("call", CALLS)
def test_columns_that_are_missing_are_named(call: str) -> None:
    kind = CALLS[call][1]
    first, *_, last = kind.schema
    text = refusal(call, pl.DataFrame(schema=kind.schema).drop(first, last))
    assert text.startswith(f"found a polars frame, without the columns {first}, {last}; expected")


@pytest.mark.parametrize("call", CALLS)
def test_columns_of_a_wrong_type_are_named_with_both(call: str) -> None:
    kind = CALLS[call][1]
    name = next(name for name in kind.schema if name.endswith("_ns"))
    text = refusal(call, pl.DataFrame(schema=kind.schema).with_columns(pl.col(name).cast(pl.Float32)))
    assert f"a frame of {kind.name}, with columns of a wrong type: {name} (Float32, not Int64); expected" in text


def test_logs_are_told_from_their_events() -> None:
    text = refusal("intervals", hrclog.Logs(EVENTS, pl.DataFrame(schema=SIGNALS)))
    assert text.startswith("found a hrclog Logs; ")
    assert text.endswith("; its .events is one")


def test_missing_and_mistyped_columns_are_told_together() -> None:
    text = refusal("durations", INTERVALS.drop("role").with_columns(pl.col("start_ns").cast(pl.String)))
    assert "without the columns role; with columns of a wrong type: start_ns (String, not Int64);" in text


def test_a_frame_of_nothing_lacks_everything() -> None:
    assert "without the columns run_id, agent, task," in refusal("overlaps", pl.DataFrame())


def test_further_columns_and_another_order_are_fine() -> None:
    mixed = INTERVALS.select(reversed(INTERVALS.columns)).with_columns(note=pl.lit("mine"))
    check_frame(mixed, INTERVALS_FRAME)
    assert hrclog.durations(mixed).equals(hrclog.durations(INTERVALS))


def test_right_frames_pass() -> None:
    assert hrclog.intervals(EVENTS).height == 1
    assert hrclog.metrics(INTERVALS, EVENTS, pl.DataFrame(schema=SIGNALS)).height > 0


def test_a_kind_is_defined_and_made_where_it_says() -> None:
    for kind in (EVENTS_FRAME, INTERVALS_FRAME, SIGNALS_FRAME):
        module, _, name = kind.defined_as.rpartition(".")
        assert getattr(pytest.importorskip(module), name) is kind.schema
        assert getattr(hrclog, kind.made_by.removeprefix("hrclog.").partition("(")[0])
