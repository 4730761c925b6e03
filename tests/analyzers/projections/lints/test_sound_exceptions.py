"""What looks like a fault and is none: each says nothing by the code that it resembles."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest
from doubtful_runs import (
    SECOND,
    Runs,
    change,
    executions_of,
    remarks,
    set_details,
    sound_runs,
    without_executions,
)
from event_frames import Row, event
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.analyzers.projections.lints.told import length, listed

SIMULATED = {"engine": "events", "hrclog": "0.1.0"}


def codes(runs: Runs) -> set[str]:
    return {remark.code for remark in remarks(runs)}


def halved(rows: list[Row]) -> list[Row]:
    return without_executions(rows, executions_of(rows)[::2])


def test_a_condition_with_fewer_executions_is_told_by_its_tag() -> None:
    runs = sound_runs(1, n_runs=10)
    for number, name in enumerate(runs):
        set_details(runs[name], tags={"condition": "short" if number in (3, 7) else "long", "trial": str(number)})
        if number in (3, 7):
            runs[name] = halved(runs[name])
    assert codes(runs) == set()
    for name in runs:
        set_details(runs[name], tags={"condition": "long"})
    assert codes(runs) == {"short_run"}


@pytest.mark.parametrize("n_short", [4, 5, 7])
def test_where_runs_differ_anyway_none_is_short(n_short: int) -> None:
    runs = sound_runs(2, n_runs=10)
    for name in list(runs)[:n_short]:
        runs[name] = halved(runs[name])
    assert "short_run" not in codes(runs)


def test_two_runs_do_not_tell_what_is_usual() -> None:
    runs = sound_runs(3, n_runs=2)
    runs["rep_0"] = halved(runs["rep_0"])
    assert codes(runs) == set()


def test_further_attempts_make_no_other_run_short() -> None:
    runs = sound_runs(4)
    for name in list(runs)[1:]:
        for execution in executions_of(runs[name], "robot"):
            attempt = [row for row in runs[name] if row["execution_id"] == execution]
            runs[name] += [row | {"execution_id": f"{execution}+", "attempt": 2} for row in attempt]
    assert "short_run" not in codes(runs)


def test_a_run_with_its_plan_is_judged_by_it_alone() -> None:
    runs = sound_runs(5, planned=True)
    gone = executions_of(runs["rep_2"])[8:]
    kept = {row["item_id"] for row in runs["rep_2"] if row["item_id"] and row["execution_id"] not in gone}
    runs["rep_2"] = without_executions(runs["rep_2"], gone)
    assert codes(runs) == {"missing_from_plan"}
    plan = json.loads(runs["rep_2"][0]["details"])["plan"]["items"]
    set_details(runs["rep_2"], plan={"items": [item for item in plan if item["item_id"] in kept]})
    assert codes(runs) == set()


def test_an_item_that_was_given_up_is_not_missing() -> None:
    runs = sound_runs(6, planned=True)
    [gone] = executions_of(runs["rep_1"])[7:8]
    given_up = next(row for row in runs["rep_1"] if row["execution_id"] == gone) | {"kind": "task_ended"}
    runs["rep_1"] = without_executions(runs["rep_1"], [gone])
    assert codes(runs) == {"missing_from_plan"}
    runs["rep_1"].append(given_up | {"outcome": "skipped"})
    assert codes(runs) == set()


@pytest.mark.parametrize("plan", ["sort", {"name": "sort"}, {"items": "all"}, {"items": [{"agent": "robot"}]}, [1]])
def test_a_plan_without_items_misses_none(plan: object) -> None:
    runs = sound_runs(7)
    for name in runs:
        set_details(runs[name], plan=plan)
    assert codes(runs) == set()


def test_annotations_may_come_days_later_and_before_the_start() -> None:
    runs = sound_runs(8)
    for name, rows in runs.items():
        for time in (rows[0]["time_ns"] - 9 * SECOND, rows[-1]["time_ns"] + 30 * 86_400 * SECOND):
            rows.append(event("annotation_added", time, run_id=f"id-{name}", reason="the light was off"))
    assert codes(runs) == set()


def test_a_run_that_was_resumed_after_its_end_has_nothing_outside() -> None:
    runs = sound_runs(9)
    rows = runs["rep_0"]
    middle = rows[20]["time_ns"]
    rows.append(event("run_ended", middle, run_id="id-rep_0", outcome="canceled"))
    details = json.dumps({"agents": ["robot", "human", "lift"], "segment": 2})
    rows.append(event("run_started", middle + 1, run_id="id-rep_0", details=details))
    assert codes(runs) == set()
    last = executions_of(rows, "human")[-1]
    change(rows, lambda row: row["execution_id"] == last, agent="lift")
    assert codes(runs) == set()  # the second segment names it


@pytest.mark.parametrize("by", [-0.09, 0.09])
def test_clocks_that_differ_a_little_put_nothing_outside(by: float) -> None:
    runs = sound_runs(10)
    for rows in runs.values():
        edge = rows[0 if by < 0 else -1]["time_ns"] + round(by * SECOND)
        rows.append(event("heartbeat", edge, run_id=rows[0]["run_id"], agent="robot"))
    assert codes(runs) == set()


def test_an_agent_to_whom_the_plan_gives_nothing_may_be_watched() -> None:
    runs = sound_runs(11, planned=True)
    plan = json.loads(runs["rep_3"][0]["details"])["plan"]["items"]
    set_details(runs["rep_3"], plan={"items": [item for item in plan if item["agent"] == "human"]})
    runs["rep_3"] = without_executions(runs["rep_3"], executions_of(runs["rep_3"], "robot"))
    assert codes(runs) == set()
    set_details(runs["rep_3"], plan=None)
    assert {"idle_agent"} <= codes(runs)


@pytest.mark.parametrize(("outcome", "is_told"), [("timed_out", False), ("canceled", False), ("failed", True)])
def test_an_execution_that_was_stopped_may_be_long(outcome: str, is_told: bool) -> None:
    runs = sound_runs(12)
    execution = executions_of(runs["rep_1"], "human")[-1]
    end = runs["rep_1"][-1]["time_ns"] + 400 * SECOND
    change(
        runs["rep_1"],
        lambda row: row["execution_id"] == execution and row["kind"] == "task_ended",
        time_ns=end,
        outcome=outcome,
    )
    runs["rep_1"][-1]["time_ns"] = end
    change(runs["rep_1"], lambda row: row["kind"] == "run_ended", time_ns=end)
    assert codes(runs) == ({"long_execution"} if is_told else set())


def test_nobody_removes_failures_of_a_simulation() -> None:
    runs = sound_runs(13)
    for rows in runs.values():
        change(rows, lambda row: row["kind"] == "task_ended", outcome="succeeded")
    assert codes(runs) == {"single_outcome"}
    for rows in runs.values():
        set_details(rows, software=SIMULATED)
    assert codes(runs) == set()
    set_details(runs["rep_4"], software={"recorder": "2.0"})
    assert [remark.message[:27] for remark in remarks(runs)] == ["all 24 executions succeeded"]


def test_one_failure_is_enough_to_believe_the_outcomes() -> None:
    runs = sound_runs(14)
    for name in list(runs)[1:]:
        change(runs[name], lambda row: row["kind"] == "task_ended", outcome="succeeded")
    assert codes(runs) == set()


def test_whole_seconds_alone_make_no_durations_identical() -> None:
    runs = sound_runs(15)
    for rows in runs.values():
        for row in rows:
            row["time_ns"] = row["time_ns"] // SECOND * SECOND
    assert "identical_durations" not in codes(runs)


def test_a_planned_end_at_its_start_is_kept() -> None:
    runs = sound_runs(16)
    for rows in runs.values():
        for row in rows:
            row["planned_end_ns"] = row["planned_start_ns"]
    assert codes(runs) == set()


@pytest.mark.parametrize(
    "spoil",
    [
        lambda rows: change(rows, lambda row: row["kind"] == "run_started", details="{"),
        lambda rows: change(rows, lambda row: row["kind"] == "run_started", details='{"agents": 7, "plan": 7}'),
        lambda rows: rows.__delitem__(slice(1, -1)),
        lambda rows: rows.__delitem__(slice(1, None)),
        lambda rows: change(rows, lambda row: row["kind"] == "run_started", time_ns=rows[-1]["time_ns"] + 9 * SECOND),
        lambda rows: rows.pop(0),
    ],
)
def test_spoilt_runs_break_no_lint(spoil: Callable[[list[Row]], object]) -> None:
    runs = sound_runs(17)
    spoil(runs["rep_1"])
    remarks(runs)
    remarks({"rep_1": runs["rep_1"]})


@settings(max_examples=50)
@given(st.floats(-1e12, 1e12))
def test_a_length_of_time_is_in_seconds_first(seconds: float) -> None:
    text = length(seconds)
    assert text.split(" ")[1] == "s"
    assert float(text.split(" ")[0]) == pytest.approx(seconds, abs=1e-3)


def test_lists_are_short() -> None:
    assert [listed(["a"] * n) for n in (1, 3, 4, 2000)] == [
        "a",
        "a, a, a",
        "a, a, a and 1 more",
        "a, a, a and 1,997 more",
    ]
