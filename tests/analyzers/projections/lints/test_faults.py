"""Faults of meaning, each put into sound runs in several variants: found by its code and no other, where it is."""

from __future__ import annotations

import json
from collections.abc import Callable
from random import Random

import pytest
from doubtful_runs import (
    SECOND,
    TASKS,
    Runs,
    change,
    executions_of,
    remarks,
    rescale,
    set_details,
    sound_runs,
    without_executions,
)
from event_frames import event

Fault = Callable[[Runs, Random], tuple[str, set[str]]]
"""Puts a fault into runs and returns the run that has it, "" for all of them, and what must be told of it."""

FAULTS: dict[tuple[str, str], Fault] = {}
"""By name and code."""

ALSO: dict[str, set[str]] = {
    # what else is true of the runs then
    "forgotten_end": {"self_overlap", "after_run_end"},
    "stood_still": {"self_overlap", "after_run_end"},
    "instants_in_another_unit": {"wrong_unit"},
    "durations_of_days": {"self_overlap", "after_run_end", "implausible_time", "long_execution"},
    "thousand_times_as_long": {"self_overlap", "after_run_end", "long_execution"},
    "paused_when_the_log_ends": {"open_execution"},
}

PAUSES = ("task_paused", "task_resumed")
VARIANTS = range(5)
OPTIONS = {"planned": ("items_deleted", "items_counted", "changed_plan", "broken_off"), "no_ids": ("items_counted",)}


def fault(code: str) -> Callable[[Fault], Fault]:
    def add(build: Fault) -> Fault:
        FAULTS[build.__name__, code] = build
        return build

    return add


@pytest.mark.parametrize("variant", range(2))
@pytest.mark.parametrize("planned", [False, True])
@pytest.mark.parametrize("ids", [False, True])
def test_sound_runs_are_quiet(variant: int, planned: bool, ids: bool) -> None:
    assert remarks(sound_runs(variant, planned=planned, ids=ids)) == []


def test_there_are_thirty_faults() -> None:
    assert len(FAULTS) >= 30


@fault("missing_from_plan")
def items_deleted(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name = random.choice(list(runs))
    agent, n = random.choice(list(TASKS)), random.randint(1, 3)
    gone = random.sample(executions_of(runs[name], agent), n)
    items = {row["item_id"] for row in runs[name] if row["execution_id"] in gone}
    runs[name] = without_executions(runs[name], gone)
    return name, {f"{n} of 24 items", repr(agent), *items}


@fault("missing_from_plan")
def items_counted(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name = random.choice(list(runs))
    agent = random.choice(list(TASKS))
    task = random.choice(TASKS[agent])
    runs[name] = without_executions(runs[name], random.sample(executions_of(runs[name], agent, task), 2))
    return name, {"2 of 24 items", repr(agent), repr(task)}


@fault("missing_from_plan")
def changed_plan(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name = random.choice(list(runs))
    task = random.choice(["weld", "polish", "carry"])
    plan = [{"item_id": "extra", "agent": "robot", "task": task}]
    changed = event("plan_changed", runs[name][0]["time_ns"] + 9 * SECOND, run_id=f"id-{name}")
    runs[name].append(changed | {"details": json.dumps({"plan": {"items": plan}})})
    return name, {"1 of 1 item", repr(task)}


@fault("missing_from_plan")
def broken_off(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name = random.choice(list(runs))
    kept = random.randint(3, 9)
    gone = executions_of(runs[name])[kept:]
    runs[name] = without_executions(runs[name], gone)
    change(runs[name], lambda row: row["kind"] == "run_ended", outcome="canceled")
    return name, {f"{24 - kept} of 24 items", "ended as canceled"}


@fault("short_run")
def cut_short(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name = random.choice(list(runs))
    kept = random.randint(7, 18)
    runs[name] = without_executions(runs[name], executions_of(runs[name])[kept:])
    return name, {f"{kept} executions", "4 runs", "24"}


@fault("short_run")
def cut_short_among_other_names(runs: Runs, random: Random) -> tuple[str, set[str]]:
    names = random.sample(["monday", "tuesday", "ann", "second try", "cell B", "ok"], len(runs))
    for rows, name in zip(runs.values(), names, strict=True):
        set_details(rows, name=name)
    run, name = random.choice(list(zip(runs, names, strict=True)))
    runs[run] = without_executions(runs[run], executions_of(runs[run])[12:])
    return run, {name, "12 executions", "24"}


@fault("short_run")
def task_left_out(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name = random.choice(list(runs))
    task = random.choice(TASKS["human"])
    runs[name] = without_executions(runs[name], executions_of(runs[name], "human", task))
    return name, {f"0 of 4 of 'human', {task!r}"}


@fault("after_run_end")
def execution_after_the_end(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name = random.choice(list(runs))
    agent, by = random.choice(list(TASKS)), random.choice([0.5, 3, 10, 400, 90_000])
    start = runs[name][-1]["time_ns"] + round(by * SECOND)
    values = {"run_id": f"id-{name}", "agent": agent, "task": TASKS[agent][0], "execution_id": "late"}
    runs[name] += [event("task_started", start, **values), event("task_ended", start + 2 * SECOND, **values)]
    return name, {"execution late", repr(agent), f"{by:.3f} s" if by < 3600 else f"{by:g} s"}


@fault("after_run_end")
def stray_safety_after_the_end(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name = random.choice(list(runs))
    by = random.randint(1, 500)
    time = runs[name][-1]["time_ns"] + by * SECOND
    kind, agent = random.choice(["safety_state_changed", "heartbeat"]), random.choice(list(TASKS))
    runs[name].append(event(kind, time, run_id=f"id-{name}", agent=agent))
    return name, {kind, repr(agent), f"{by}.000 s"}


@fault("before_run_start")
def clock_behind(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name = random.choice(list(runs))
    agent, by = random.choice(list(TASKS)), random.randint(20, 5000)
    for row in runs[name]:
        row["time_ns"] -= by * SECOND if row["agent"] == agent else 0
    return name, {repr(agent), f"execution {executions_of(runs[name], agent)[0]}", "before its run_started"}


@fault("before_run_start")
def start_written_late(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name = random.choice(list(runs))
    by = random.randint(4, 12)
    runs[name][0]["time_ns"] += by * SECOND
    return name, {f"{by - 1}.000 s", executions_of(runs[name])[0]}


@fault("undeclared_agent")
def mistyped_agent(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name = random.choice(list(runs))
    agent, typed = random.choice([("robot", "robto"), ("human", "humann"), ("robot", "robot_1"), ("human", "hunan")])
    execution = random.choice(executions_of(runs[name], agent))
    change(runs[name], lambda row: row["execution_id"] == execution, agent=typed)
    return name, {repr(typed), "1 execution", execution, f"is it {agent!r}?", "'robot', 'human'"}


@fault("undeclared_agent")
def agent_not_in_the_list(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name = random.choice(list(runs))
    agent = random.choice(list(TASKS))
    set_details(runs[name], agents=[other for other in TASKS if other != agent])
    return name, {repr(agent), "12 executions"}


@fault("idle_agent")
def safety_under_another_name(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name = random.choice(list(runs))
    called = random.choice(["ur5", "arm", "left", "R", "cobot"])
    change(runs[name], lambda row: row["kind"] == "safety_state_changed", agent=called)
    return name, {repr(called), "3 safety events", "'robot'"}


@fault("idle_agent")
def declared_and_idle(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name = random.choice(list(runs))
    called = random.choice(["ur5", "arm", "left", "lift", "cobot"])
    set_details(runs[name], agents=[*TASKS, called])
    change(runs[name], lambda row: row["kind"] == "safety_state_changed", agent=called)
    return name, {repr(called), "3 safety events"}


@fault("never_resumed")
def resume_not_written(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name = random.choice(list(runs))
    agent = random.choice(list(TASKS))
    execution = executions_of(runs[name], agent)[3]
    runs[name] = [row for row in runs[name] if (row["execution_id"], row["kind"]) != (execution, "task_resumed")]
    return name, {execution, repr(agent), "never resumed", "2026-05-2"}


@fault("never_resumed")
def second_pause_not_resumed(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name = random.choice(list(runs))
    execution = executions_of(runs[name], "robot")[3]
    end = next(row for row in runs[name] if (row["execution_id"], row["kind"]) == (execution, "task_ended"))
    by = random.choice([0.1, 0.25, 0.5, 0.75, 1])
    runs[name].append(end | {"kind": "task_paused", "time_ns": end["time_ns"] - round(by * SECOND), "outcome": ""})
    return name, {execution, f"{by:.3f} s later", "succeeded"}


@fault("never_resumed")
def paused_when_the_log_ends(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name = random.choice(list(runs))
    agent = random.choice(list(TASKS))
    execution = executions_of(runs[name], agent)[-1]
    start = next(row["time_ns"] for row in runs[name] if row["execution_id"] == execution)
    end = next(row for row in runs[name] if (row["execution_id"], row["kind"]) == (execution, "task_ended"))
    end.update(kind="task_paused", time_ns=start + SECOND // 2, outcome="")
    return name, {execution, repr(agent), "neither resumed nor ended"}


@fault("planned_backwards")
def planned_columns_swapped(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name = random.choice(list(runs))
    chosen = random.sample(executions_of(runs[name]), random.randint(1, 3))
    for row in runs[name]:
        if row["execution_id"] in chosen and row["kind"] == "task_started":
            row["planned_start_ns"], row["planned_end_ns"] = row["planned_end_ns"], row["planned_start_ns"]
    return name, {*chosen, "count as unset"}


@fault("planned_backwards")
def planned_end_of_the_day_before(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name = random.choice(list(runs))
    execution = random.choice(executions_of(runs[name]))
    by = random.randint(1, 20) * 3600
    start = next(row for row in runs[name] if row["execution_id"] == execution)
    start["planned_end_ns"] = start["planned_start_ns"] - by * SECOND
    return name, {execution, repr(start["task"]), f"by {by}.000 s"}


@fault("identical_durations")
def durations_filled_in(runs: Runs, random: Random) -> tuple[str, set[str]]:
    agent, took = random.choice(list(TASKS)), random.choice([0.25, 0.5, 0.75, 1, 1.25])
    task = random.choice(TASKS[agent])
    n = _set_durations(runs, agent, task, lambda _: took)
    return "", {f"all {n}", repr(agent), repr(task), f"{took:.3f} s"}


@fault("identical_durations")
def durations_filled_in_as_floats(runs: Runs, random: Random) -> tuple[str, set[str]]:
    task, took = random.choice(TASKS["human"]), random.choice([0.5, 0.75, 1, 1.25])
    n = _set_durations(runs, "human", task, lambda _: took + random.uniform(-4e-7, 4e-7))
    return "", {f"all {n}", repr(task), f"{took:.3f} s"}


@fault("identical_durations")
def nearly_all_durations_filled_in(runs: Runs, random: Random) -> tuple[str, set[str]]:
    task, took = random.choice(TASKS["robot"]), random.choice([0.5, 0.75, 1, 1.25])
    n = _set_durations(runs, "robot", task, lambda number: took * (1.2 if number in (4, 9) else 1))
    return "", {f"{n - 2} of {n}", repr(task), f"{took:.3f} s"}


@fault("single_outcome")
def failures_removed(runs: Runs, random: Random) -> tuple[str, set[str]]:
    for name in list(runs)[random.randint(1, 5) :]:
        del runs[name]
    for name in runs:
        failed = [row["execution_id"] for row in runs[name] if row["outcome"] == "failed"]
        runs[name] = without_executions(runs[name], failed)
    return "", {f"all {23 * len(runs)} executions succeeded"}


@fault("single_outcome")
def outcomes_filled_in(runs: Runs, random: Random) -> tuple[str, set[str]]:
    outcome = random.choice(["failed", "canceled", "timed_out", "skipped", "succeeded"])
    for rows in runs.values():
        change(rows, lambda row: row["kind"] == "task_ended", outcome=outcome)
    return "", {"all 120 executions", outcome.replace("_", " ")}


@fault("few_outcomes")
def a_handful_all_succeeded(runs: Runs, random: Random) -> tuple[str, set[str]]:
    n, name = random.randint(3, 9), random.choice(list(runs))
    rows = without_executions(runs[name], executions_of(runs[name])[n:])
    change(rows, lambda row: row["kind"] == "task_ended", outcome="succeeded")
    runs.clear()
    runs[name] = [row for row in rows if row["kind"] != "safety_state_changed"]
    return "", {f"all {n} executions succeeded"}


@fault("long_execution")
def stood_still(runs: Runs, random: Random) -> tuple[str, set[str]]:
    return _lengthen(runs, random, random.choice([12, 20, 35, 60, 100]))


@fault("long_execution")
def forgotten_end(runs: Runs, random: Random) -> tuple[str, set[str]]:
    return _lengthen(runs, random, random.choice([500, 1500, 4000, 9000, 20_000]))


@fault("shared_execution_id")
def copied_run(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name = random.choice(list(runs))
    day = random.randint(1, 300) * 86_400 * SECOND
    runs["copy_1"] = [row | {"run_id": "id-copy_1", "time_ns": row["time_ns"] + day} for row in runs[name]]
    for row in runs["copy_1"]:
        row.update(planned_start_ns=None, planned_end_ns=None)
    set_details(runs["copy_1"], name="copy_1")
    return "", {"24 execution ids", repr(name), "'copy_1'"}


@fault("shared_execution_id")
def counted_anew_in_each_run(runs: Runs, random: Random) -> tuple[str, set[str]]:
    prefix = random.choice(["", "e", "exec-", "#", "T"])
    for rows in runs.values():
        numbers = {execution: f"{prefix}{number}" for number, execution in enumerate(executions_of(rows))}
        for row in rows:
            row["execution_id"] = numbers.get(row["execution_id"], "")
    return "", {"24 execution ids", "5 runs", f"{prefix}0 ("}


@fault("wrong_unit")
def durations_of_microseconds(runs: Runs, random: Random) -> tuple[str, set[str]]:
    return _rescale(runs, random, random.choice([1e-6, 1e-5, 2e-4]))


@fault("wrong_unit")
def durations_of_milliseconds(runs: Runs, random: Random) -> tuple[str, set[str]]:
    return _rescale(runs, random, 1e-3)


@fault("wrong_unit")
def thousand_times_as_long(runs: Runs, random: Random) -> tuple[str, set[str]]:
    return _rescale(runs, random, 1e3)


@fault("wrong_unit")
def durations_of_days(runs: Runs, random: Random) -> tuple[str, set[str]]:
    return _rescale(runs, random, random.choice([4e4, 86_400.0, 1e6]))


@fault("wrong_unit")
def planned_in_another_unit(runs: Runs, random: Random) -> tuple[str, set[str]]:
    agent, factor = random.choice(list(TASKS)), random.choice([1e-6, 1e-3, 1e3])
    for rows in runs.values():
        change(rows, lambda row: row["kind"] == "task_started", planned_start_ns=None, planned_end_ns=None)
    name = random.choice(list(runs))
    change(runs[name], lambda row: row["kind"] == "task_ended" and row["agent"] == agent, planned_duration_s=3 * factor)
    return name, {repr(agent), "12 executions", "planned"}


@fault("similar_names")
def name_typed_in_two_ways(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name, task = random.choice(list(runs)), random.choice(TASKS["human"])
    typed = random.choice([task.upper(), f"{task} ", task.title(), f"{task}\u200b", f" {task}"])
    executions = executions_of(runs[name], "human", task)[:1]
    change(runs[name], lambda row: row["execution_id"] in executions, task=typed)
    return "", {repr(task), "1 execution"}


@fault("open_execution")
def end_not_written(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name, agent = random.choice(list(runs)), random.choice(list(TASKS))
    execution = random.choice(executions_of(runs[name], agent))
    runs[name] = [row for row in runs[name] if (row["execution_id"], row["kind"]) != (execution, "task_ended")]
    return name, {repr(agent), "never ended"}


@fault("zero_duration")
def start_written_at_the_end(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name, agent = random.choice(list(runs)), random.choice(list(TASKS))
    execution = random.choice(executions_of(runs[name], agent)[6:])
    end = next(row for row in runs[name] if (row["execution_id"], row["kind"]) == (execution, "task_ended"))
    change(runs[name], lambda row: row["execution_id"] == execution, time_ns=end["time_ns"])
    return name, {repr(agent), "1 execution"}


@fault("self_overlap")
def two_at_once(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name, agent = random.choice(list(runs)), random.choice(list(TASKS))
    execution, by = executions_of(runs[name], agent)[random.randint(0, 2)], random.randint(2, 4)
    change(
        runs[name],
        lambda row: row["execution_id"] == execution and row["kind"] == "task_ended",
        time_ns=next(row["time_ns"] for row in runs[name] if row["execution_id"] == execution) + 3 * by * SECOND,
    )
    return name, {repr(agent), "overlaps itself"}


@fault("implausible_time")
def instants_in_another_unit(runs: Runs, random: Random) -> tuple[str, set[str]]:
    name, factor = random.choice(list(runs)), random.choice([10**3, 10**6, 10**9])
    for row in runs[name]:
        row.update(time_ns=row["time_ns"] // factor, planned_start_ns=None, planned_end_ns=None)
    return name, {"1970"}


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize(("name", "code"), FAULTS)
def test_a_fault_is_found_by_its_code_and_no_other(name: str, code: str, variant: int) -> None:
    runs = sound_runs(variant, planned=name in OPTIONS["planned"], ids=name not in OPTIONS["no_ids"])
    run, told = FAULTS[name, code](runs, Random(f"{name} {variant}"))
    every = remarks(runs)
    of_code = [remark for remark in every if remark.code == code]
    assert of_code, every
    assert {remark.run_id for remark in of_code} == {f"id-{run}"} or not run
    assert len(of_code) == 1 or not run
    assert [text for text in told if not any(text in remark.message for remark in of_code)] == [], of_code
    assert {remark.code for remark in every} - {code} <= ALSO.get(name, set()), every


def _set_durations(runs: Runs, agent: str, task: str, took_s: Callable[[int], float]) -> int:
    """Set the durations of a task by their number, and return how many there are."""
    count = 0
    for rows in runs.values():
        for execution in executions_of(rows, agent, task):
            start = next(row["time_ns"] for row in rows if row["execution_id"] == execution)
            rows[:] = [
                row
                for row in rows
                if row["execution_id"] != execution or row["kind"][:5] + row["kind"][5:7] != "task_pa"
            ]
            rows[:] = [row for row in rows if row["execution_id"] != execution or row["kind"] not in PAUSES]
            end = start + round(took_s(count) * SECOND)
            change(rows, lambda row: row["execution_id"] == execution and row["kind"] == "task_ended", time_ns=end)  # noqa: B023
            count += 1
    return count


def _lengthen(runs: Runs, random: Random, factor: float) -> tuple[str, set[str]]:
    name, agent = random.choice(list(runs)), random.choice(list(TASKS))
    execution = random.choice([one for one in executions_of(runs[name], agent) if not one.endswith(("-3", "-5"))])
    start = next(row for row in runs[name] if row["execution_id"] == execution)
    end = start["time_ns"] + round(factor * (2 + TASKS[agent].index(start["task"])) * SECOND)
    change(runs[name], lambda row: row["execution_id"] == execution and row["kind"] == "task_ended", time_ns=end)
    return name, {execution, repr(agent), repr(start["task"]), "times the median"}


def _rescale(runs: Runs, random: Random, factor: float) -> tuple[str, set[str]]:
    name, agent = random.choice(list(runs)), random.choice(list(TASKS))
    rescale(runs[name], agent, factor)
    return name, {repr(agent), "12 executions", "another unit"}
