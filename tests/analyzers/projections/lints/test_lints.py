"""Lints: each is found where it is, and only there."""

from __future__ import annotations

from pathlib import Path

import pytest

from hrclog.analyzers.analysis import analyze
from hrclog.analyzers.result import Analysis
from hrclog.events import AnnotationAdded, Event, RunEnded, RunStarted, TaskEnded, TaskStarted
from hrclog.log.writing.writer import write_log

DAY_NS = 24 * 3600 * 10**9
NOON = 1_700_000_000 * 10**9


def execution(agent: str, start: int, end: int | None, number: int, outcome: str = "succeeded") -> list[Event]:
    fact = {"agent": agent, "task": "pick", "execution_id": f"e{number}", "run_id": "r"}
    ended = [] if end is None else [TaskEnded(time_ns=end, outcome=outcome, **fact)]
    return [TaskStarted(time_ns=start, **fact), *ended]


def analysed(folder: Path, *events: Event) -> Analysis:
    ordered = sorted(events, key=lambda event: event.time_ns)
    write_log(folder / "run.mcap", [RunStarted(time_ns=ordered[0].time_ns, run_id="r"), *ordered])
    return analyze(folder / "run.mcap")


def codes(analysis: Analysis) -> set[str]:
    return {finding.code for finding in analysis.diagnostics}


def test_a_plain_run_has_no_findings(tmp_path: Path) -> None:
    events = [*execution("H", NOON, NOON + 5, 1), *execution("R", NOON, NOON + 7, 2)]
    assert codes(analysed(tmp_path, *events, RunEnded(time_ns=NOON + 7, run_id="r"))) == set()


@pytest.mark.parametrize(
    ("code", "events"),
    [
        ("open_execution", [*execution("H", NOON, None, 1), *execution("R", NOON, NOON + 7, 2)]),
        ("zero_duration", [*execution("H", NOON, NOON, 1), *execution("R", NOON, NOON + 7, 2)]),
        ("self_overlap", [*execution("R", NOON, NOON + 5, 1), *execution("R", NOON + 1, NOON + 7, 2)]),
        ("implausible_time", [*execution("H", 1_700_000_000, 1_700_000_005, 1), *execution("R", NOON, NOON + 7, 2)]),
        ("implausible_time", [*execution("H", NOON, NOON + 8 * DAY_NS, 1), *execution("R", NOON, NOON + 7, 2)]),
        ("one_agent", execution("H", NOON, NOON + 5, 1)),
        ("run_not_ended", execution("H", NOON, NOON + 5, 1)),
        ("single_outcome", [e for n in range(100) for e in execution("H", NOON + 9 * n, NOON + 9 * n + 5, n)]),
    ],
)
def test_each_lint_is_found(code: str, events: list[Event], tmp_path: Path) -> None:
    assert code in codes(analysed(tmp_path, *events))


def test_one_failure_is_enough_to_believe_the_outcomes(tmp_path: Path) -> None:
    events = [e for n in range(100) for e in execution("H", NOON + 9 * n, NOON + 9 * n + 5, n)]
    failed = execution("H", NOON + 9000, NOON + 9005, 1000, "failed")
    assert "single_outcome" not in codes(analysed(tmp_path, *events, *failed))


def test_an_annotation_of_later_days_does_not_prolong_an_open_execution(tmp_path: Path) -> None:
    events = [*execution("H", NOON, None, 1), *execution("R", NOON, NOON + 7, 2)]
    later = AnnotationAdded(time_ns=NOON + 2 * DAY_NS, run_id="r", reason="the camera was off")
    analysis = analysed(tmp_path, *events, later)
    assert analysis.intervals.filter(analysis.intervals["agent"] == "H")["until_ns"].to_list() == [NOON + 7]
    assert analysis.runs["makespan_s"].to_list() == [7e-9]
