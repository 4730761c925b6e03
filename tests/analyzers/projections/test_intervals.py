"""Events into intervals: the columns agree with the state machine, and what it refuses is told."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from event_frames import PATH, Row, event, event_rows, frame
from hypothesis import assume, given, settings
from polars.testing import assert_frame_equal

from hrclog.analyzers.projections import intervals as module
from hrclog.analyzers.projections.intervals import intervals, rebuild
from hrclog.analyzers.projections.schemas import INTERVALS
from hrclog.diagnostic import CODES, Diagnostic
from hrclog.errors import InvalidEventError
from hrclog.event_rows import from_row
from hrclog.events import OUTCOME_NOT_TOLD, Outcome, TaskDispatched, TaskEnded, TaskFact, TaskStarted
from hrclog.log.logs import ORDER
from hrclog.log.one_log import read_log
from hrclog.log.writing.writer import write_log
from hrclog.state import PLANNED, ExecutionState, apply

Facts = dict[tuple[str, str], dict[str, Any]]


UNTOLD = ("outcome_not_told", "outcome_assumed")


def folded(events: pl.DataFrame) -> tuple[Facts, list[tuple[str, str, int]]]:
    """Return executions and (code, run, seq) by the state machine alone, written as plainly as can be."""
    states: dict[tuple[str, str], ExecutionState] = {}
    accepted: dict[tuple[str, str], list[Row]] = {}
    found = []
    for row in events.sort(ORDER).to_dicts():
        try:
            fact = from_row(row)
        except InvalidEventError:
            found.append(("invalid_details", row["run_id"], row["seq"]))
            fact = from_row(row | {"details": ""})
        if not isinstance(fact, TaskFact):
            continue
        key = (row["run_id"], row["execution_id"])
        state, code = apply(states.get(key, PLANNED), fact)
        if code:
            found.append((code, row["run_id"], row["seq"]))
        if code in (None, "invalid_outcome"):
            states[key] = state
            accepted.setdefault(key, []).append(row)
    starts: dict[tuple[str, str, str], list[int]] = {}
    for key, rows in accepted.items():
        starts.setdefault(_lane(key, rows), []).extend(row["time_ns"] for row in rows if row["kind"] == "task_started")
    return {
        key: _expected(states[key], rows, events, starts[_lane(key, rows)])
        for key, rows in accepted.items()
        if states[key].start_ns is not None
    }, found


def _lane(key: tuple[str, str], rows: list[Row]) -> tuple[str, str, str]:
    start = next((row for row in rows if row["kind"] == "task_started"), rows[0])
    return key[0], start["agent"], start["parent_execution_id"]


def _expected(state: ExecutionState, accepted: list[Row], events: pl.DataFrame, starts: list[int]) -> dict[str, Any]:
    by_kind = {row["kind"]: row for row in accepted}
    start, plan = by_kind["task_started"], by_kind.get("task_dispatched", {})
    end = by_kind.get("task_ended", {})
    last = max(row["time_ns"] for row in events.to_dicts() if row["run_id"] == start["run_id"])
    following = [other for other in starts if other > state.start_ns]  # of the same agent
    kept = ("agent", "task", "task_type", "role", "parent_execution_id", "attempt", "path")
    ends = {name: end.get(name) for name in ("planned_duration_s", "planning_time_s", "path_length")}
    plans = {
        name: start[name] if start[name] is not None else plan.get(name)
        for name in ("planned_start_ns", "planned_end_ns")
    }
    return (
        {name: start[name] for name in kept}
        | {"dispatched_ns": plan.get("time_ns")}
        | ends
        | plans
        | {
            "item_id": start["item_id"] or plan.get("item_id", ""),
            "start_ns": state.start_ns,
            "end_ns": state.end_ns,
            "until_ns": min([last, *following]) if state.end_ns is None else state.end_ns,
            "outcome": _expected_outcome(state, [row for row in events.to_dicts() if row["run_id"] == start["run_id"]]),
            "reason": end.get("reason", ""),
            "target": end.get("target", ""),
            "paused_ns": state.paused_ns,
        }
    )


def _expected_outcome(state: ExecutionState, events: list[Row]) -> str:
    if state.end_ns is None or state.outcome:
        return state.outcome or "unknown"
    ends = [row for row in events if row["kind"] == "task_ended"]
    return "unknown" if any(row["outcome"] or OUTCOME_NOT_TOLD in row["details"] for row in ends) else "completed"


@settings(max_examples=100)
@given(event_rows())
def test_intervals_and_diagnostics_are_those_of_a_plain_fold_of_the_state_machine(rows: list[Row]) -> None:
    events = frame(rows)
    found, diagnostics = rebuild(events)
    assume(all(one.code != "clock_step" for one in diagnostics))  # test_clock_step.py has those
    expected, complaints = folded(events)
    names = ("run_id", "execution_id")
    by_key = {tuple(row[name] for name in names): row for row in found.to_dicts()}
    assert {
        key: {name: row[name] for name in INTERVALS if name not in names} for key, row in by_key.items()
    } == expected
    assert found.height == len(by_key)
    assert found.schema == INTERVALS
    assert sorted((one.code, one.run_id, one.seq) for one in diagnostics if one.code not in UNTOLD) == sorted(
        complaints
    )
    assert all((one.path == PATH) == (one.code not in UNTOLD) and one.code in CODES for one in diagnostics)


@pytest.mark.slow
@settings(max_examples=60)
@given(event_rows())
def test_folding_every_execution_gives_what_pairing_the_regular_ones_gives(rows: list[Row]) -> None:
    events = frame(rows)
    found, diagnostics = rebuild(events)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_find_regular_keys", lambda frame: frame.select("run_id", "execution_id").clear())
        folded_frame, folded_diagnostics = rebuild(events)
    assert_frame_equal(found, folded_frame)
    assert diagnostics == folded_diagnostics


@settings(max_examples=30)
@given(event_rows())
def test_the_order_of_the_events_in_the_file_does_not_matter(rows: list[Row]) -> None:
    events = frame(rows)
    assert_frame_equal(intervals(events), intervals(events.reverse()))
    assert rebuild(events)[1] == rebuild(events.reverse())[1]


ILLEGAL = {
    "end_without_start": ([], event("task_ended", 4)),
    "duplicate_start": ([event("task_started", 1)], event("task_started", 4)),
    "event_after_end": ([event("task_started", 1), event("task_ended", 2)], event("task_ended", 4)),
    "dispatch_after_start": ([event("task_started", 1)], event("task_dispatched", 4)),
    "pause_without_start": ([], event("task_paused", 4)),
    "pause_while_paused": ([event("task_started", 1), event("task_paused", 2)], event("task_paused", 4)),
    "resume_without_pause": ([event("task_started", 1)], event("task_resumed", 4)),
    "identity_changed": ([event("task_started", 1)], event("task_ended", 4, agent="B")),
    "missing_identity": ([], event("task_started", 4, execution_id="")),
    "invalid_outcome": ([event("task_started", 1)], event("task_ended", 4, outcome="exploded")),
    "invalid_details": ([event("task_started", 1)], event("task_ended", 4, details="[]")),
}


@pytest.mark.parametrize("code", ILLEGAL)
def test_an_illegal_event_is_named_with_its_file_and_number(code: str) -> None:
    legal, illegal = ILLEGAL[code]
    assert rebuild(frame(legal))[1] == []
    found, diagnostics = rebuild(frame([*legal, illegal]))
    assert [(one.code, one.path, one.run_id, one.seq) for one in diagnostics] == [(code, PATH, "run", len(legal))]
    assert found.height == min(len(legal), 1)


def test_an_end_before_its_start_ends_nothing() -> None:
    found, diagnostics = rebuild(frame([event("task_ended", 1), event("task_started", 4), event("heartbeat", 9)]))
    assert found.select("start_ns", "end_ns", "until_ns").rows() == [(4, None, 9)]
    assert [one.code for one in diagnostics] == ["end_without_start"]


def test_every_code_that_the_state_machine_gives_is_explained() -> None:
    assert set(module._WHY) == set(ILLEGAL) - {"invalid_details"}
    assert set(ILLEGAL) <= set(CODES)


def test_an_outcome_outside_the_vocabulary_still_ends_the_execution() -> None:
    found, _ = rebuild(frame([event("task_started", 1), event("task_ended", 4, outcome="exploded")]))
    assert found.select("end_ns", "outcome").rows() == [(4, "unknown")]


def test_an_open_execution_lasts_at_most_until_its_agent_starts_the_next() -> None:
    rows = [
        event("task_started", 10),
        event("task_started", 30, execution_id="e2"),
        event("task_started", 30, execution_id="e3"),
        event("heartbeat", 70),
    ]
    found = intervals(frame(rows)).sort("execution_id")
    assert found["until_ns"].to_list() == [30, 70, 70]


def test_an_open_execution_lasts_until_the_last_instant_of_its_run() -> None:
    rows = [event("task_started", 10), event("heartbeat", 70), event("heartbeat", 900, run_id="another")]
    found = intervals(frame(rows))
    assert found.select("start_ns", "end_ns", "until_ns", "outcome").rows() == [(10, None, 70, "unknown")]


def test_pauses_add_up_and_the_end_closes_the_last() -> None:
    kinds = ("task_started", "task_paused", "task_resumed", "task_paused", "task_ended")
    found = intervals(frame([event(kind, time) for kind, time in zip(kinds, (0, 10, 13, 20, 24), strict=True)]))
    assert found.select("start_ns", "end_ns", "paused_ns").rows() == [(0, 24, 3 + 4)]


def test_retries_are_executions_of_their_own_that_share_their_item() -> None:
    first = {"execution_id": "e1", "item_id": "i", "attempt": 1}
    second = {"execution_id": "e2", "item_id": "i", "attempt": 2}
    rows = [
        event("task_started", 0, **first),
        event("task_ended", 5, **first, outcome="failed", reason="slipped"),
        event("task_started", 6, **second),
        event("task_ended", 9, **second),
    ]
    found = intervals(frame(rows)).select("execution_id", "item_id", "attempt", "outcome", "reason")
    assert found.rows() == [("e1", "i", 1, "failed", "slipped"), ("e2", "i", 2, "succeeded", "")]


@pytest.mark.parametrize(("said_at_start", "expected"), [(None, 100), (7, 7)])
def test_planned_times_come_from_the_dispatch_unless_the_start_names_them(
    said_at_start: int | None, expected: int
) -> None:
    rows = [
        event("task_dispatched", 0, planned_start_ns=100, planned_end_ns=200, item_id="i"),
        event("task_started", 1, planned_start_ns=said_at_start),
        event("task_ended", 2),
    ]
    found = intervals(frame(rows)).select("planned_start_ns", "planned_end_ns", "item_id")
    assert found.rows() == [(expected, 200, "i")]


def test_an_execution_skipped_before_it_started_is_no_interval_and_no_error() -> None:
    found, diagnostics = rebuild(frame([event("task_dispatched", 0), event("task_ended", 1, outcome="skipped")]))
    assert (found.height, diagnostics) == (0, [])


def test_one_id_in_two_runs_is_two_executions() -> None:
    rows = [event(kind, time, run_id=run) for run in "rs" for kind, time in (("task_started", 0), ("task_ended", 5))]
    assert intervals(frame(rows)).height == 2


def test_no_events_give_no_intervals() -> None:
    found, diagnostics = rebuild(frame([]))
    assert found.schema == INTERVALS
    assert (found.height, diagnostics) == (0, [])


def test_what_was_written_comes_back_as_intervals(tmp_path: Path) -> None:
    identity = {"run_id": "run", "agent": "R", "task": "pick", "execution_id": "e", "task_type": "pick"}
    written = [
        TaskDispatched(time_ns=5, planned_start_ns=11, planned_end_ns=21, item_id="i", **identity),
        TaskStarted(time_ns=10, item_id="i", **identity),
        TaskEnded(time_ns=25, outcome=Outcome.FAILED, reason="slipped", path_length=2.5, target="box_1", **identity),
    ]
    write_log(tmp_path / "run.mcap", written)
    found = intervals(read_log(tmp_path / "run.mcap").events).to_dicts()[0]
    expected = identity | {
        "role": "primary", "parent_execution_id": "", "item_id": "i", "attempt": 1, "dispatched_ns": 5, "start_ns": 10,
        "end_ns": 25, "until_ns": 25, "outcome": "failed", "reason": "slipped", "paused_ns": 0, "planned_start_ns": 11,
        "planned_end_ns": 21, "planned_duration_s": None, "planning_time_s": None, "path_length": 2.5,
        "target": "box_1", "path": str(tmp_path / "run.mcap"),
    }  # fmt: skip
    assert found == expected


def test_a_diagnostic_tells_which_event_was_refused_and_why() -> None:
    diagnostic: Diagnostic = rebuild(frame([event("task_ended", 4)]))[1][0]
    assert diagnostic.message == "task_ended of 'A', 'x' (execution e) is not allowed: it never started"


def test_regular_executions_do_not_pass_through_the_state_machine_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> Callable[..., Any]:
        raise AssertionError("a regular execution went through the state machine")

    monkeypatch.setattr(module, "apply", refuse)
    rows = [
        event(kind, time, execution_id=f"e{n}")
        for n in range(50)
        for kind, time in (("task_started", n), ("task_ended", n + 1))
    ]
    assert intervals(frame(rows)).height == 50
