"""The state machine of an execution: axioms over any sequence of events, and the whole table of steps."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest
from event_strategies import TASK_FACTS
from hypothesis import given
from hypothesis import strategies as st

from hrclog.diagnostic import CODES
from hrclog.events import (
    UNKNOWN_OUTCOME,
    Outcome,
    TaskDispatched,
    TaskEnded,
    TaskFact,
    TaskPaused,
    TaskResumed,
    TaskStarted,
)
from hrclog.state import PLANNED, ExecutionState, Phase, apply


def _fact(cls: type[TaskFact], time_ns: int = 5, outcome: str = "") -> TaskFact:
    event = cls(time_ns=time_ns, agent="robot", task="pick", execution_id="e")
    return replace(event, outcome=outcome) if outcome else event


def _sequences() -> st.SearchStrategy[list[TaskFact]]:
    """Return events that mostly belong to one execution, so that long legal runs occur."""
    outcomes = st.sampled_from([*Outcome, "exploded", ""])
    classes = st.sampled_from([TaskDispatched, TaskStarted, TaskPaused, TaskResumed, TaskEnded])
    usual = st.builds(_fact, classes, st.integers(0, 100))
    ended = st.builds(_fact, st.just(TaskEnded), st.integers(0, 100), outcomes)
    return st.lists(st.one_of(usual, usual, ended, TASK_FACTS), max_size=12)


@given(_sequences())
def test_a_step_that_is_not_allowed_changes_nothing_and_is_named(events: list[TaskFact]) -> None:
    state = PLANNED
    for event in events:
        after, problem = apply(state, event)
        assert problem is None or problem in CODES
        if problem is not None and problem != "invalid_outcome":
            assert after == state
        state = after


@given(_sequences())
def test_an_allowed_step_changes_the_phase_along_the_life_of_an_execution(events: list[TaskFact]) -> None:
    allowed = {
        (Phase.PLANNED, Phase.DISPATCHED),
        (Phase.PLANNED, Phase.STARTED),
        (Phase.PLANNED, Phase.ENDED),
        (Phase.DISPATCHED, Phase.STARTED),
        (Phase.DISPATCHED, Phase.ENDED),
        (Phase.STARTED, Phase.PAUSED),
        (Phase.PAUSED, Phase.STARTED),
        (Phase.STARTED, Phase.ENDED),
        (Phase.PAUSED, Phase.ENDED),
    }
    for before, after in pairwise(_states(events)):
        assert before == after or (before.phase, after.phase) in allowed


@given(_sequences(), TASK_FACTS)
def test_the_end_is_final(events: list[TaskFact], event: TaskFact) -> None:
    state, _ = apply(_states([*events, _fact(TaskStarted)])[-1], _fact(TaskEnded))
    state = replace(state, phase=Phase.ENDED)
    after, problem = apply(state, event)
    assert after == state
    assert problem in ("event_after_end", "duplicate_start")


@given(_sequences())
def test_the_fields_of_a_state_agree_with_its_phase(events: list[TaskFact]) -> None:
    for state in _states(events):
        assert (state.outcome != "") == (state.phase is Phase.ENDED) == (state.end_ns is not None)
        assert (state.paused_since_ns is not None) == (state.phase is Phase.PAUSED)
        assert (state.agent != "") == (state.phase is not Phase.PLANNED)
        if state.phase in (Phase.STARTED, Phase.PAUSED):
            assert state.start_ns is not None


def _states(events: list[TaskFact]) -> list[ExecutionState]:
    states = [PLANNED]
    for event in events:
        states.append(apply(states[-1], event)[0])
    return states


BEFORE = {
    Phase.PLANNED: [],
    Phase.DISPATCHED: [_fact(TaskDispatched, 1)],
    Phase.STARTED: [_fact(TaskStarted, 1)],
    Phase.PAUSED: [_fact(TaskStarted, 1), _fact(TaskPaused, 2)],
    Phase.ENDED: [_fact(TaskStarted, 1), _fact(TaskEnded, 2)],
}

ENDED, LATE, UNSTARTED = "ended", "event_after_end", "end_without_start"
TWICE, NOT_PAUSABLE, AGAIN = "duplicate_start", "pause_without_start", "dispatch_after_start"
TABLE = {
    "dispatched": (TaskDispatched, "", ["dispatched", AGAIN, AGAIN, AGAIN, LATE]),
    "started": (TaskStarted, "", ["started", "started", TWICE, TWICE, TWICE]),
    "paused": (TaskPaused, "", [NOT_PAUSABLE, NOT_PAUSABLE, "paused", "pause_while_paused", LATE]),
    "resumed": (TaskResumed, "", [NOT_PAUSABLE, NOT_PAUSABLE, "resume_without_pause", "started", LATE]),
    "succeeded": (TaskEnded, "succeeded", [UNSTARTED, UNSTARTED, ENDED, ENDED, LATE]),
    "failed": (TaskEnded, "failed", [UNSTARTED, ENDED, ENDED, ENDED, LATE]),
    "timed_out": (TaskEnded, "timed_out", [UNSTARTED, ENDED, ENDED, ENDED, LATE]),
    "canceled": (TaskEnded, "canceled", [ENDED, ENDED, ENDED, ENDED, LATE]),
    "skipped": (TaskEnded, "skipped", [ENDED, ENDED, ENDED, ENDED, LATE]),
    "exploded": (TaskEnded, "exploded", [UNSTARTED, UNSTARTED, "invalid_outcome", "invalid_outcome", LATE]),
}
"""Per event: what it leads to from planned, dispatched, started, paused, ended: a phase or a diagnostic code."""


@pytest.mark.parametrize("name", TABLE)
def test_every_step_from_every_phase_leads_where_the_table_says(name: str) -> None:
    cls, outcome, expected = TABLE[name]
    found = []
    for phase, events in BEFORE.items():
        state = _states(events)[-1]
        assert state.phase is phase
        after, problem = apply(state, _fact(cls, 5, outcome))
        found.append(problem or str(after.phase))
    assert found == expected


def test_an_execution_keeps_its_times_and_the_sum_of_its_pauses() -> None:
    events = [
        _fact(TaskStarted, 10),
        _fact(TaskPaused, 20),
        _fact(TaskResumed, 25),
        _fact(TaskPaused, 30),
        _fact(TaskEnded, 37, "failed"),
    ]
    state = _states(events)[-1]
    assert (state.start_ns, state.end_ns, state.paused_ns, state.outcome) == (10, 37, 12, "failed")


def test_an_end_with_an_outcome_outside_the_vocabulary_ends_as_unknown() -> None:
    state, problem = apply(_states([_fact(TaskStarted)])[-1], _fact(TaskEnded, 9, "exploded"))
    assert (state.phase, state.outcome, problem) == (Phase.ENDED, UNKNOWN_OUTCOME, "invalid_outcome")


@pytest.mark.parametrize("field", ["agent", "task"])
def test_an_execution_cannot_change_its_agent_or_task(field: str) -> None:
    state = _states([_fact(TaskStarted)])[-1]
    assert apply(state, replace(_fact(TaskEnded), **{field: "other"})) == (state, "identity_changed")


@pytest.mark.parametrize("field", ["agent", "task", "execution_id"])
def test_an_event_without_identity_is_not_allowed(field: str) -> None:
    assert apply(PLANNED, replace(_fact(TaskStarted), **{field: ""})) == (PLANNED, "missing_identity")
