"""The long table: each execution once, beside whom by the definition, and nothing that a name could break."""

from __future__ import annotations

from typing import Any, Final

import polars as pl
import pytest
from event_frames import event, event_rows
from event_frames import frame as events_of
from hypothesis import given, settings
from hypothesis import strategies as st
from interval_frames import frame, row, rows
from run_frames import runs_of

import hrclog
from hrclog.analyzers.projections import executions as module
from hrclog.analyzers.projections.executions import executions
from hrclog.analyzers.projections.schemas import EXECUTIONS, RUNS
from hrclog.log.logs import Logs
from hrclog.log.messages.signals import SIGNAL_COLUMNS

Row = dict[str, Any]

UNIT: Final = 10**6
"""Ns of the grid on which executions lie."""


def table_of(intervals: pl.DataFrame, tags: dict[str, dict[str, str]] | None = None) -> pl.DataFrame:
    return executions(intervals, runs_of(intervals), tags or {})


def busy_instants(intervals: pl.DataFrame, run: str, agent: str) -> set[int]:
    """Return the units of time in which an agent has an execution."""
    lane = intervals.filter(pl.col("run_id") == run, pl.col("agent") == agent, pl.col("parent_execution_id") == "")
    return {
        now for start, end in lane.select("start_ns", "until_ns").rows() for now in range(start // UNIT, end // UNIT)
    }


@settings(max_examples=30)
@given(rows(scale=UNIT))
def test_seconds_beside_an_agent_are_those_in_which_it_has_an_execution_too(drawn: list[Row]) -> None:
    intervals = frame(drawn)
    table = table_of(intervals)
    whole = intervals.filter(pl.col("parent_execution_id") == "")
    assert sorted(table["execution_id"]) == sorted(whole["execution_id"])
    agents = {run: set(part["agent"]) for (run,), part in intervals.group_by("run_id")}
    of_execution = {each["execution_id"]: each for each in intervals.iter_rows(named=True)}
    for line in table.iter_rows(named=True):
        own = of_execution[line["execution_id"]]
        span = set(range(own["start_ns"] // UNIT, own["until_ns"] // UNIT))
        for agent in sorted({each["agent"] for each in drawn}):
            expected = None
            if agent != line["agent"] and agent in agents[line["run_id"]]:
                expected = len(span & busy_instants(intervals, line["run_id"], agent)) / 1e3
            assert line.get(f"beside_{agent}_s") == expected


@settings(max_examples=15)
@given(event_rows())
def test_every_execution_of_a_run_is_a_row_with_what_its_interval_says(drawn: list[Row]) -> None:
    logs = Logs(events_of(drawn), SIGNAL_COLUMNS.to_frame(), [])
    analysis = hrclog.analyze(logs)
    table = analysis.executions
    whole = analysis.intervals.filter(pl.col("parent_execution_id") == "")
    counts = dict(table.group_by("run_id").len().iter_rows())
    assert counts == {run: n for run, n in analysis.runs.select("run_id", "n_executions").iter_rows() if n}
    key = ["run_id", "execution_id"]
    joined = table.join(whole, on=key).join(analysis.runs, on="run_id", suffix="_of_run")
    assert joined.height == table.height
    start = joined["start_ns"] - joined["start_ns_of_run"]
    assert joined["start_s"].to_list() == [ns / 1e9 for ns in start]
    lengths = joined["end_ns"] - joined["start_ns"]
    assert joined["duration_s"].to_list() == [None if ns is None else ns / 1e9 for ns in lengths]
    assert (joined["until_s"] >= joined["start_s"]).all()
    assert joined["duration_s"].is_null().to_list() == joined["end_ns"].is_null().to_list()
    for name in ("agent", "task", "role", "attempt", "outcome", "reason"):
        assert joined[name].to_list() == joined[f"{name}_right"].to_list()
    assert analysis.executions is table


def test_an_idle_agent_is_beside_for_no_second_and_one_of_another_run_is_unknown() -> None:
    intervals = frame([
        row("H", "x", 0, 4_000_000_000), row("R", "y", 5_000_000_000, 6_000_000_000),
        row("H", "x", 0, 1_000_000_000, run_id="alone"),
    ])  # fmt: skip
    table = table_of(intervals).select("run_id", "agent", "beside_H_s", "beside_R_s")
    assert table.rows() == [("alone", "H", None, None), ("run", "H", None, 0.0), ("run", "R", 0.0, None)]


def test_an_agent_that_is_only_announced_is_idle() -> None:
    events = events_of([
        event("run_started", 0, details='{"agents": ["A", "B"]}'), event("task_started", 1), event("task_ended", 3),
    ])  # fmt: skip
    table = hrclog.analyze(Logs(events, SIGNAL_COLUMNS.to_frame(), [])).executions
    assert table.select("agent", "beside_A_s", "beside_B_s").rows() == [("A", None, 0.0)]


def test_a_run_without_executions_is_no_row_and_no_run_is_an_empty_table() -> None:
    events = events_of([event("run_started", 0, details='{"agents": ["A"], "tags": {"lab": "n"}}')])
    only_started = hrclog.analyze(Logs(events, SIGNAL_COLUMNS.to_frame(), [])).executions
    assert only_started.height == 0
    empty = executions(frame([]), RUNS.to_frame(), {})
    assert empty.schema == EXECUTIONS


KEYS = ["participant", "task", "run", "beside_H_s", "tag_task", "<script>", "=cmd()", "a b", ""]


@settings(max_examples=20)
@given(st.dictionaries(st.sampled_from(KEYS), st.text(max_size=3), max_size=5))
def test_tags_are_columns_behind_the_run_whatever_they_are_called(tags: dict[str, str]) -> None:
    intervals = frame([row("H", "x", 0, 2), row("R", "y", 1, 3), row("H", "x", 0, 1, run_id="untold")])
    table = table_of(intervals, {"run": tags})
    bare = table_of(intervals)
    assert table.select(bare.columns).equals(bare)
    names = table.columns[2 : 2 + len(tags)]
    assert set(names) == set(table.columns) - set(bare.columns)
    told = dict(zip(sorted(tags), names, strict=True))
    for key, text in tags.items():
        assert told[key] in (key, f"tag_{key}", f"tag_tag_{key}")
        assert dict(table.select("run_id", told[key]).iter_rows()) == {"run": text, "untold": ""}


def test_too_many_agents_have_no_columns_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MOST_CELLS", 3)
    assert table_of(frame([row("H", "x", 0, 2), row("R", "y", 1, 3)])).columns == EXECUTIONS.names()
