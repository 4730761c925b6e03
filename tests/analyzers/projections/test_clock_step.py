"""Executions whose clock was put back while they went on."""

from __future__ import annotations

import pytest
from event_frames import event, frame

from hrclog.analyzers.projections.intervals import rebuild
from hrclog.analyzers.projections.lints.lints import lint
from hrclog.analyzers.projections.overlaps import overlaps
from hrclog.analyzers.projections.runs import runs


def test_an_end_timed_before_its_start_is_a_step_of_the_clock() -> None:
    events = frame(
        [event("task_started", 3700), event("task_ended", 110), event("task_started", 200, execution_id="f")]
    )
    found, (step,) = rebuild(events)
    assert (step.code, step.severity, step.seq) == ("clock_step", "warning", 1)
    assert found.filter(found["execution_id"] == "e").select("start_ns", "end_ns", "outcome", "paused_ns").rows() == [
        (3700, None, "unknown", 0)
    ]


def test_such_an_execution_is_not_called_open_and_one_without_an_end_is() -> None:
    events = frame(
        [event("task_started", 3700), event("task_ended", 110), event("task_started", 200, execution_id="f")]
    )
    found, _ = rebuild(events)
    lints = lint(events, found, overlaps(found), runs(events, found))
    assert [one.message[:17] for one in lints if one.code == "open_execution"] == ["'A', 'x' started "]


def test_a_step_within_a_pause_leaves_start_and_end() -> None:
    kinds = (("task_started", 100), ("task_paused", 130), ("task_resumed", 120), ("task_ended", 150))
    found, (step,) = rebuild(frame(event(kind, time) for kind, time in kinds))
    assert step.code == "clock_step"
    assert found.select("start_ns", "end_ns", "outcome", "paused_ns").rows() == [(100, 150, "succeeded", 0)]


@pytest.mark.parametrize(
    "kinds",
    [
        (("task_ended", 5),),
        (("task_ended", 5), ("task_started", 6)),
        (("task_started", 9), ("task_ended", 4), ("task_ended", 5)),
    ],
)
def test_what_is_illegal_in_the_order_of_writing_too_is_told_as_before(kinds: tuple[tuple[str, int], ...]) -> None:
    _, diagnostics = rebuild(frame(event(kind, time) for kind, time in kinds))
    assert "clock_step" not in {one.code for one in diagnostics}
    assert "end_without_start" in {one.code for one in diagnostics}


def test_late_writing_alone_is_no_step() -> None:
    rows = [event("task_ended", 20, seq=1), event("task_started", 10, seq=2)]
    found, diagnostics = rebuild(frame(rows))
    assert diagnostics == []
    assert found.select("start_ns", "end_ns").rows() == [(10, 20)]
