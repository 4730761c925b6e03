"""Events frames made by hand and by hypothesis, the illegal ones too."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import polars as pl
from hypothesis import strategies as st

from hrclog.events import COLUMNS, FLOAT_COLUMNS, INT_COLUMNS
from hrclog.log.messages.decode import frame_of_rows

Row = dict[str, Any]

PATH = "some.mcap"

_EMPTY: Row = dict.fromkeys(COLUMNS, "") | dict.fromkeys((*INT_COLUMNS, *FLOAT_COLUMNS))
_EMPTY |= {"schema_version": 1, "attempt": 0, "seq": 0, "log_time_ns": 0}

LEGAL = (
    ("task_started", "task_ended"),
    ("task_started",),
    ("task_dispatched", "task_started", "task_ended"),
    ("task_dispatched", "task_started"),
    ("task_started", "task_paused", "task_resumed", "task_ended"),
    ("task_started", "task_paused", "task_ended"),
    ("task_dispatched", "task_ended"),
)
NEARLY_LEGAL = (
    ("task_ended", "task_started"),
    ("task_started", "task_dispatched", "task_ended"),
    ("task_dispatched", "task_dispatched", "task_started", "task_ended"),
    ("task_started", "task_ended", "task_ended"),
    ("task_started", "task_ended", "task_started"),
)
KINDS = ("task_dispatched", "task_started", "task_paused", "task_resumed", "task_ended")
_MOSTLY_SUCCEEDED = ("succeeded",) * 6 + ("failed", "canceled", "skipped", "timed_out", "exploded", "unknown", "")
_DETAILS = ("", "", "", "{}", '{"a":[1,NaN]}', '{"a":"\\ud800"}', "[1]", "{", '{"a":1} x', "7", "{'a':1}")


def event(kind: str, time_ns: int, **values: object) -> Row:
    """Return one event row of the execution e of A's x, unless it says otherwise."""
    identity = {"run_id": "run", "agent": "A", "task": "x", "execution_id": "e", "role": "primary", "attempt": 1}
    defaults = identity if kind.startswith("task_") else {"run_id": "run"}
    if kind == "task_ended":
        defaults |= {"outcome": "succeeded"}
    return _EMPTY | {"kind": kind, "time_ns": time_ns} | defaults | values


def frame(rows: Iterable[Mapping[str, Any]], path: str = PATH) -> pl.DataFrame:
    """Return an events frame; `seq` counts the rows of each run in the order given, unless they have one."""
    counts: dict[str, int] = {}
    numbered = []
    for row in rows:
        seq = counts[row["run_id"]] = counts.get(row["run_id"], -1) + 1
        numbered.append(dict(row) | {"seq": row["seq"] or seq})
    return frame_of_rows(numbered).with_columns(pl.lit(path).alias("path"))


@st.composite
def event_rows(draw: st.DrawFn) -> list[Row]:
    """Draw the events of a few executions in two runs: legal lives, and lives with anything at any place."""
    found: list[Row] = []
    for number in range(draw(st.integers(0, 5))):
        run, agent = draw(st.tuples(st.sampled_from("rs"), st.sampled_from("AAB")))
        kinds = draw(st.one_of(st.sampled_from(LEGAL + NEARLY_LEGAL), st.lists(st.sampled_from(KINDS), max_size=6)))
        name = draw(st.sampled_from((f"e{number}",) * 8 + ("e0", "")))
        now = draw(st.integers(0, 6))
        for kind in kinds:
            values: Row = {"run_id": run, "agent": agent, "task": f"t{number % 3}", "execution_id": name}
            values |= _odd(draw)
            found.append(event(kind, now, **_extras(draw, kind), **values))
            now += draw(st.integers(0, 4))
    if draw(st.booleans()):
        found.append(event("heartbeat", draw(st.integers(0, 40)), run_id="r"))
    return found


def _odd(draw: st.DrawFn) -> Row:
    """Draw a change of identity, rarely."""
    return draw(st.sampled_from(({},) * 20 + ({"agent": "C"}, {"task": "other"}, {"agent": ""}, {"task": ""})))


def _extras(draw: st.DrawFn, kind: str) -> Row:
    values: Row = {"details": draw(st.sampled_from(_DETAILS)), "task_type": draw(st.sampled_from(("", "pick")))}
    values["role"] = draw(st.sampled_from(("primary", "auxiliary")))
    values["attempt"] = draw(st.integers(1, 3))
    if kind in ("task_dispatched", "task_started"):
        values["item_id"] = draw(st.sampled_from(("", "i1", "i2")))
        values["planned_start_ns"] = draw(st.sampled_from((None, 3, 5)))
        values["planned_end_ns"] = draw(st.sampled_from((None, 9)))
    if kind == "task_ended":
        values["outcome"] = draw(st.sampled_from(_MOSTLY_SUCCEEDED))
        values["reason"] = draw(st.sampled_from(("", "slipped")))
        values["planning_time_s"] = draw(st.sampled_from((None, 0.25)))
        values["path_length"] = draw(st.sampled_from((None, 1.5)))
        values["target"] = draw(st.sampled_from(("", "box_3")))
    return values
