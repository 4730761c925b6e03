"""Ends without an outcome: completed where their run tells none at all, else unknown; said once, with the count."""

from __future__ import annotations

from pathlib import Path

import pytest

from hrclog.analyzers.analysis import analyze
from hrclog.events import OUTCOME_NOT_TOLD, Event, RunStarted, TaskEnded, TaskStarted
from hrclog.log.writing.writer import write_log


def run_of(name: str, outcomes: list[str], *, marked: bool = False) -> list[Event]:
    events: list[Event] = [RunStarted(time_ns=10**18, run_id=name, name=name)]
    for number, outcome in enumerate(outcomes):
        facts = {"run_id": name, "agent": "r", "task": "t", "execution_id": f"{name}{number}"}
        begin = 10**18 + number * 10**10
        events.append(TaskStarted(time_ns=begin, **facts))
        details = {OUTCOME_NOT_TOLD: ""} if marked and not outcome else {}
        events.append(TaskEnded(time_ns=begin + 10**9, outcome=outcome, details=details, **facts))
    return events


CASES = [
    # outcomes, marked, outcomes of the intervals, durations that count, success rate, codes
    (["", ""], False, ["completed", "completed"], 2, None, {"outcome_assumed"}),
    (["", ""], True, ["unknown", "unknown"], 0, None, {"outcome_not_told"}),
    (["", "succeeded"], False, ["unknown", "succeeded"], 1, 1.0, {"outcome_not_told"}),
    (["failed", "succeeded"], False, ["failed", "succeeded"], 1, 0.5, set()),
]


@pytest.mark.parametrize(("outcomes", "marked", "expected", "count", "rate", "codes"), CASES)
def test_an_end_without_an_outcome_counts_by_what_its_run_tells(
    outcomes: list[str],
    marked: bool,
    expected: list[str],
    count: int,
    rate: float | None,
    codes: set[str],
    tmp_path: Path,
) -> None:
    write_log(tmp_path / "a.mcap", run_of("a", outcomes, marked=marked))
    analysis = analyze(tmp_path)
    assert analysis.intervals["outcome"].to_list() == expected
    assert analysis.durations.select("count", "success_rate").rows() == [(count, rate)]
    told = {finding.code for finding in analysis.diagnostics} & {
        "outcome_assumed",
        "outcome_not_told",
        "invalid_outcome",
    }
    assert told == codes


def test_the_number_of_ends_that_count_as_completed_is_said_once(tmp_path: Path) -> None:
    for name in "abc":
        write_log(tmp_path / f"{name}.mcap", run_of(name, ["", ""]))
    (finding,) = [one for one in analyze(tmp_path).diagnostics if one.code == "outcome_assumed"]
    assert "6 executions" in finding.message
