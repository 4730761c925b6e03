"""`hrclog run` and `hrclog plan`: plans drawn, carried out and told about."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from hrclog.event_rows import from_row
from hrclog.events import Event, RunStarted, TaskEnded, TaskFact, TaskStarted
from hrclog.log.reader import read_events
from hrclog.planning.plan import read_plan, write_plan
from hrclog.sim.run import plan_of
from hrclog.sim.scenario import SCENARIO_FOLDER, load_scenario

Run = Callable[..., Any]

PAPER = load_scenario("paper")


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    """Return the file of a plan of the paper's cell."""
    path = tmp_path / "plan.json"
    write_plan(path, plan_of(PAPER, 1, 0))
    return path


@pytest.fixture
def script(tmp_path: Path) -> Callable[..., Path]:
    """Write scripts: 10 ms for every task of an agent, but for what is said otherwise."""

    def write(agent: str, **odd: dict[str, object]) -> Path:
        path = tmp_path / f"{agent}.json"
        tasks = [task.name for task in PAPER.problem.tasks if agent in task.agents]
        steps = [{"agent": agent, "task": task, "duration_s": 0.01} | odd.get(task, {}) for task in tasks]
        path.write_text(json.dumps({"steps": steps}))
        return path

    return write


def logged(path: Path) -> list[Event]:
    return [from_row(row) for row in read_events(path).iter_rows(named=True)]


@pytest.mark.slow
def test_plans_are_drawn_into_files_that_can_be_run(run: Run, tmp_path: Path) -> None:
    result = run("plan", "failures", "--random", 3, "--seed", 5, "-o", tmp_path / "plans")
    assert result.code == 0
    assert result.out == f"3 plans of failures: {tmp_path}/plans/plan-001.json .. plan-003.json\n"
    plans = [read_plan(path) for path in sorted((tmp_path / "plans").iterdir())]
    assert len({str(plan.orders()) for plan in plans}) == 3
    assert run("run", tmp_path / "plans" / "plan-002.json", "-o", tmp_path / "x.mcap").code == 0
    again = run("plan", "failures", "--random", 2, "-o", tmp_path / "plans")
    assert again.code == 1
    assert "plan-001.json: exists already" in again.err
    assert run("plan", "failures", "--random", 9999, "-o", tmp_path / "more").code == 1


def test_drawn_plans_as_json(run: Run, tmp_path: Path) -> None:
    result = run("plan", "paper", "--random", 1, "-o", tmp_path, "--json").json()
    assert result == {"problem": "paper", "seed": 1, "plans": [str(tmp_path / "plan-001.json")]}


@pytest.mark.parametrize("mode", ["sequential", "timed", "synchronous", "asynchronous", "reactive"])
def test_a_plan_is_carried_out_in_every_mode(mode: str, run: Run, plan: Path, tmp_path: Path) -> None:
    result = run("run", plan, "--mode", mode, "-o", tmp_path / "out.mcap")
    assert (result.code, result.err) == (0, "")
    items, makespan, look = result.out.splitlines()
    assert items == f"{read_plan(plan).name}: 24 of 24 items succeeded, log in {tmp_path}/out.mcap"
    assert re.fullmatch(r"makespan \d+\.\d s; planned 86\.7 \(undisturbed\)", makespan)
    assert look == f"Look at it: hrclog view {tmp_path}/out.mcap"
    first = logged(tmp_path / "out.mcap")[0]
    assert isinstance(first, RunStarted)
    assert (first.name, first.dispatch_mode, first.plan) == ("out", mode, read_plan(plan).to_json())


def test_the_same_arguments_give_the_same_bytes_and_others_other_ids(run: Run, plan: Path, tmp_path: Path) -> None:
    for folder, more in (("a", ()), ("b", ("--no-timeout",)), ("c", ("--timeout", 99))):
        (tmp_path / folder).mkdir()
        assert run("run", plan, *more, "-o", tmp_path / folder / "x").code == 0
    a, b, c = (tmp_path / folder / "x.mcap" for folder in "abc")
    assert a.read_bytes() == b.read_bytes()
    assert logged(a)[0].run_id != logged(c)[0].run_id


def test_a_replayed_agent_does_again_what_it_did(run: Run, plan: Path, tmp_path: Path) -> None:
    first, second = tmp_path / "first.mcap", tmp_path / "second.mcap"
    assert run("run", plan, "--seed", 7, "-o", first).code == 0
    agents = [f"--agent={agent}=replay:{first}" for agent in ("human", "robot")]
    assert run("run", plan, *agents, "-o", second).code == 0

    def told(path: Path) -> list[object]:
        return [(e.time_ns, e.kind, e.agent, e.item_id) for e in logged(path) if isinstance(e, TaskFact)]

    assert told(first) == told(second)


def test_nothing_is_said_of_a_safety_function_where_no_agent_is_simulated(
    run: Run, plan: Path, script: Callable[..., Path], tmp_path: Path
) -> None:
    agents = [f"--agent={agent}=scripted:{script(agent)}" for agent in ("human", "robot")]
    for name, more in (("a", ()), ("b", ("--real-time",))):
        assert run("run", plan, *agents, *more, "-o", tmp_path / name).code == 0
        assert not [event for event in logged(tmp_path / f"{name}.mcap") if event.kind == "safety_state_changed"]
    assert run("run", plan, "--engine", "bullet", "--real-time", "-o", tmp_path / "c").code == 2


def test_items_that_did_not_succeed_are_named_and_the_exit_code_is_3(
    run: Run, plan: Path, script: Callable[..., Path], tmp_path: Path
) -> None:
    odd = script("robot", pick_blue_box={"misbehaviour": "rejects", "reason": "no gripper"})
    result = run("run", plan, f"--agent=robot=scripted:{odd}", "-o", tmp_path / "out.mcap", "--json")
    assert result.code == 3
    told = result.json()
    assert (told["outcome"], told["reason"]) == ("failed", "4 of 24 items did not succeed")
    lost = {item["task"]: item["outcome"] for item in told["items"].values() if item["outcome"] != "succeeded"}
    assert lost == {"pick_blue_box": "failed", "place_blue_box": "skipped"}
    assert "(pick_blue_box) failed: no gripper" in result.err
    assert result.err.endswith("the run failed: 4 of 24 items did not succeed\n")


def test_retries_limits_and_abort_come_from_the_options(
    run: Run, plan: Path, script: Callable[..., Path], tmp_path: Path
) -> None:
    slow = script("robot", pick_orange_box={"duration_s": 100.0}, pick_blue_box={"duration_s": 100.0})
    more = ("--timeout", 5, "--max-attempts", 2, "--on-failure", "abort")
    result = run("run", plan, f"--agent=robot=scripted:{slow}", *more, "-o", tmp_path / "out.mcap", "--json")
    assert result.code == 3
    assert result.json()["reason"].endswith("failed 2 times")
    ends = [e for e in logged(tmp_path / "out.mcap") if isinstance(e, TaskEnded) and e.agent == "robot"]
    assert [(e.outcome, e.reason) for e in ends] == [("timed_out", "took longer than 5 s")] * 2
    untold = [item for item in result.json()["items"].values() if item["outcome"] is None]
    assert untold
    assert "not begun" in result.err


def test_real_time_records_as_it_goes(run: Run, plan: Path, script: Callable[..., Path], tmp_path: Path) -> None:
    agents = [f"--agent={agent}=scripted:{script(agent)}" for agent in ("human", "robot")]
    begin_ns = time.time_ns()
    result = run("run", plan, *agents, "--real-time", "-o", tmp_path / "out.mcap")
    assert result.code == 0
    assert "24 of 24 items succeeded" in result.out
    assert result.err.count("started") == result.err.count("succeeded") == 24
    events = logged(tmp_path / "out.mcap")
    assert all(begin_ns - 10**9 < event.time_ns < time.time_ns() + 10**9 for event in events)
    assert sum(isinstance(event, TaskStarted) for event in events) == 24


def test_simulated_agents_can_be_watched_in_real_time_and_interrupted(plan: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "hrclog", "run", str(plan), "--real-time", "-o", str(tmp_path / "out.mcap")]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert "started" in process.stderr.readline()
        os.kill(process.pid, signal.SIGINT)
        assert "the run canceled: interrupted" in process.stderr.read()
        assert process.wait() == 130
    ends = [event for event in logged(tmp_path / "out.mcap") if isinstance(event, TaskEnded)]
    assert {end.outcome for end in ends} == {"canceled"}


BAD: list[tuple[str, Callable[[dict[str, Any]], object], str]] = [
    ("unknown task", lambda p: p["items"][0].update(task="fly"), "task 'fly': unknown; the tasks are"),
    ("unknown agent", lambda p: p["items"][0].update(agent="dog"), "'dog' cannot do"),
    ("circle", lambda p: p["items"][0].update(after=[p["items"][-1]["item_id"]]), "does not come before it"),
    ("missing item", lambda p: p["items"].pop(), "expected"),
    ("unknown field", lambda p: p.update(speed=1), "unknown field 'speed'"),
    ("meeting of one", lambda p: p["items"][0].update(meet="x"), "meet 'x' stands at items of"),
]


@pytest.mark.parametrize(("change", "message"), [row[1:] for row in BAD], ids=[row[0] for row in BAD])
@pytest.mark.parametrize("real_time", [False, True])
def test_a_plan_that_does_not_fit_is_refused_before_anything_runs(
    change: Callable[[dict[str, Any]], object], message: str, real_time: bool, run: Run, plan: Path, tmp_path: Path
) -> None:
    value = json.loads(plan.read_text())
    change(value)
    plan.write_text(json.dumps(value))
    result = run("run", plan, *(["--real-time"] if real_time else []), "-o", tmp_path / "out.mcap")
    assert result.code == 1
    assert message in result.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plan.json"]


def test_a_circle_that_only_the_mode_makes_is_refused(run: Run, tmp_path: Path) -> None:
    value = plan_of(PAPER, 1, 0).to_json()
    human = [item for item in value["items"] if item["agent"] == "human"]
    robot = [item for item in value["items"] if item["agent"] == "robot"]
    human[0]["after"] = [robot[3]["item_id"]]
    value["items"] = robot + human
    (tmp_path / "plan.json").write_text(json.dumps(value))
    assert run("run", tmp_path / "plan.json", "-o", tmp_path / "fine.mcap").code == 0
    result = run("run", tmp_path / "plan.json", "--mode", "synchronous", "-o", tmp_path / "out.mcap")
    assert result.code == 1
    assert "in mode synchronous the items" in result.err
    assert not (tmp_path / "out.mcap").exists()


@pytest.mark.parametrize(
    ("agent", "code", "message"),
    [
        ("dog=simulated", 2, "agent 'dog' is unknown; the agents are human, robot"),
        ("robot", 2, "expected AGENT=simulated, AGENT=replay:LOG or AGENT=scripted:FILE"),
        ("robot=magic:x", 2, "expected AGENT=simulated"),
        ("robot=replay:", 2, "expected AGENT=simulated"),
        ("robot=replay:nothing.mcap", 1, "nothing.mcap"),
        ("robot=scripted:nothing.json", 1, "nothing.json: cannot be read"),
        ("human=scripted:robot.json", 1, "found steps of robot, none of 'human'"),
    ],
)
def test_an_agent_that_cannot_act_as_asked_is_refused(
    agent: str, code: int, message: str, run: Run, plan: Path, script: Callable[..., Path], tmp_path: Path
) -> None:
    name, equals, way = agent.partition("=")
    kind, colon, file = way.partition(":")
    script("robot")
    file = str(tmp_path / file) if file and file != "x" else file
    result = run("run", plan, "--agent", f"{name}{equals}{kind}{colon}{file}", "-o", tmp_path / "out.mcap")
    assert result.code == code
    assert message in " ".join(result.err.split())
    assert not (tmp_path / "out.mcap").exists()


@pytest.mark.parametrize("real_time", [False, True])
def test_no_log_is_overwritten(real_time: bool, run: Run, plan: Path, tmp_path: Path) -> None:
    (tmp_path / "out.mcap").write_text("mine")
    result = run("run", plan, *(["--real-time"] if real_time else []), "-o", tmp_path / "out.mcap")
    assert result.code == 1
    assert "exists already" in result.err
    assert (tmp_path / "out.mcap").read_text() == "mine"


def test_facts_of_the_plan_file_arrive_in_the_run(run: Run, plan: Path, tmp_path: Path) -> None:
    value = json.loads(plan.read_text())
    value["items"][0]["needs"] = ["part_7"]
    value["arrivals"] = [{"fact": "part_7", "at_s": 33.0}]
    plan.write_text(json.dumps(value))
    assert run("run", plan, "-o", tmp_path / "out.mcap").code == 0
    notes = [event for event in logged(tmp_path / "out.mcap") if event.details.get("arrived") == "part_7"]
    assert [note.kind for note in notes] == ["annotation_added"]
    del value["arrivals"]
    plan.write_text(json.dumps(value))
    result = run("run", plan, "-o", tmp_path / "never.mcap")
    assert result.code == 3
    assert "skipped: needs part_7, which never arrived" in result.err


def test_a_plan_knows_its_problem(run: Run, tmp_path: Path) -> None:
    assert run("plan", "failures", "--random", 1, "-o", tmp_path / "plans").code == 0
    plan = tmp_path / "plans" / "plan-001.json"
    named = json.loads(plan.read_text())["problem"]
    assert named["name"] == "failures"
    assert run("run", plan, "-o", tmp_path / "x.mcap").code in (0, 3)
    [started] = [event for event in logged(tmp_path / "x.mcap") if isinstance(event, RunStarted)]
    assert started.plan["problem"] == named
    assert set(started.agents) == set(load_scenario("failures").problem.agents)


def test_a_file_of_a_scenario_is_found_beside_its_plan(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = tmp_path / "cell.json"
    cell.write_text((SCENARIO_FOLDER / "machine-tending.json").read_text())
    monkeypatch.chdir(tmp_path)
    assert run("plan", "cell.json", "--random", 1, "-o", ".").code == 0
    monkeypatch.chdir("/")
    assert run("run", tmp_path / "plan-001.json", "-o", tmp_path / "x.mcap").code == 0


@pytest.mark.parametrize(
    ("problem", "message"),
    [
        (None, "does not say which problem it was made for; name the scenario"),
        ({"name": "gone.json", "digest": ""}, "made for 'gone.json', which is no scenario, and no file"),
        ({"name": "paper", "digest": "0123456789abcdef"}, "the problem of 'paper' has changed since the plan was made"),
    ],
)
def test_a_plan_whose_problem_is_gone_is_refused(
    problem: object, message: str, run: Run, plan: Path, tmp_path: Path
) -> None:
    values = json.loads(plan.read_text()) | {"problem": problem}
    if problem is None:
        del values["problem"]
    plan.write_text(json.dumps(values))
    refused = run("run", plan, "-o", tmp_path / "x.mcap")
    assert refused.code == 1
    assert message in refused.err
    assert "--scenario" in refused.err
    assert not (tmp_path / "x.mcap").exists()
    assert run("run", plan, "--scenario", "paper", "-o", tmp_path / "x.mcap").code == 0


def test_a_problem_without_a_cell_cannot_be_simulated(run: Run, plan: Path, tmp_path: Path) -> None:
    problem = tmp_path / "problem.json"
    problem.write_text(json.dumps(PAPER.problem.to_json()))
    values = json.loads(plan.read_text())
    plan.write_text(json.dumps(values | {"problem": {"name": str(problem)}}))
    refused = run("run", plan, "-o", tmp_path / "x.mcap")
    assert refused.code == 1
    assert "a problem that says nothing of how its agents act" in refused.err


def test_what_a_plan_promised_is_printed_beside_the_makespan(run: Run, plan: Path, tmp_path: Path) -> None:
    expected = {"mean_s": 80.0, "mean_low_s": 78.0, "mean_high_s": 82.0, "run_low_s": 70.5, "run_high_s": 90.0}
    values = json.loads(plan.read_text()) | {"expected": expected | {"worlds": 400}}
    plan.write_text(json.dumps(values))
    lines = run("run", plan, "-o", tmp_path / "x.mcap").out.splitlines()
    assert "makespan 96.4 s; expected 80.0 [70.5, 90.0] (90 % of 400 single runs drawn)" in lines
    document = run("run", plan, "-o", tmp_path / "y.mcap", "--json").json()
    assert document["expected"] == expected | {"worlds": 400, "mode": ""}
    facts = read_events(tmp_path / "y.mcap").filter(pl.col("kind").is_in(["task_started", "task_ended"]))
    assert document["makespan_s"] == (facts["time_ns"].max() - facts["time_ns"].min()) / 1e9


def test_a_promise_for_another_mode_names_it(run: Run, plan: Path, tmp_path: Path) -> None:
    expected = {"mean_s": 80.0, "mean_low_s": 78.0, "mean_high_s": 82.0, "run_low_s": 70.5, "run_high_s": 90.0}
    values = json.loads(plan.read_text()) | {"expected": expected | {"worlds": 400, "mode": "sequential"}}
    plan.write_text(json.dumps(values))
    assert "(90 % of 400 single runs drawn)" in run("run", plan, "-o", tmp_path / "x.mcap").out
    other = run("run", plan, "--mode", "synchronous", "-o", tmp_path / "y.mcap").out
    assert "(90 % of 400 single runs drawn in mode sequential)" in other


def test_several_plans_and_repetitions_go_into_a_folder(run: Run, tmp_path: Path) -> None:
    assert run("plan", "paper", "--random", 2, "-o", tmp_path / "plans").code == 0
    plans, runs = sorted((tmp_path / "plans").iterdir()), tmp_path / "runs"
    result = run("run", *plans, "--repeat", 3, "-o", runs)
    assert result.code == 0
    names = [f"plan-00{plan}_{number:04d}.mcap" for plan in (1, 2) for number in range(3)]
    assert sorted(path.name for path in runs.iterdir()) == names
    first, second, look = result.out.splitlines()
    told = r"plan-001: 3 runs, mean makespan \d+\.\d s \[\d+\.\d, \d+\.\d\]; planned \d+\.\d \(undisturbed\)"
    assert re.fullmatch(told, first)
    assert second.startswith("plan-002: 3 runs")
    assert look == f"Look at them: hrclog view {tmp_path}/runs"
    ends = {tuple(e.time_ns - logged(path)[0].time_ns for e in logged(path)) for path in runs.iterdir()}
    assert len(ends) == 6  # every repetition is another run
    again = run("run", *plans, "--repeat", 3, "-o", runs)
    assert again.code == 1
    assert "plan-001_0000.mcap: exists already" in again.err
    assert run("run", *plans, "--repeat", 3, "-o", tmp_path / "same").code == 0
    for path in runs.iterdir():
        assert path.read_bytes() == (tmp_path / "same" / path.name).read_bytes()


def test_one_bad_plan_among_many_hides_no_other(run: Run, plan: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.json"
    bad.write_text("{")
    result = run("run", bad, plan, "-o", tmp_path / "runs", "--json")
    assert result.code == 3
    assert "bad.json" in result.err
    [told] = result.json()["plans"]
    assert [Path(entry["path"]).name for entry in told["runs"]] == ["plan_0000.mcap"]
    assert (told["n_succeeded"], told["mean_low_s"]) == (1, None)
    assert run("run", bad, tmp_path / "none.json", "-o", tmp_path / "none").code == 1


def test_logs_of_plans_of_one_name_would_collide(run: Run, plan: Path, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    twin = tmp_path / "other" / plan.name
    twin.write_bytes(plan.read_bytes())
    result = run("run", plan, twin, "-o", tmp_path / "runs")
    assert result.code == 2
    assert "two plans are called 'plan'" in result.err


def test_both_ways_to_run_record_the_same_facts(
    run: Run, plan: Path, script: Callable[..., Path], tmp_path: Path
) -> None:
    agents = [f"--agent={agent}=scripted:{script(agent)}" for agent in ("human", "robot")]
    opened = []
    for folder, more in (("a", ()), ("b", ("--real-time",))):
        (tmp_path / folder).mkdir()
        assert run("run", plan, *agents, *more, "-o", tmp_path / folder / "x.mcap").code == 0
        [started] = [event for event in logged(tmp_path / folder / "x.mcap") if isinstance(event, RunStarted)]
        opened.append(replace(started, time_ns=0, run_id=""))
    assert opened[0] == opened[1]


def test_equal_plans_in_a_series_are_different_runs(run: Run, plan: Path, tmp_path: Path) -> None:
    twin = tmp_path / "twin.json"
    twin.write_bytes(plan.read_bytes())
    assert run("run", plan, twin, "-o", tmp_path / "runs").code == 0
    assert len({logged(path)[0].run_id for path in (tmp_path / "runs").iterdir()}) == 2


def test_a_folder_is_no_log(run: Run, plan: Path, tmp_path: Path) -> None:
    refused = run("run", plan, "-o", tmp_path)
    assert refused.code == 2
    assert "is a folder" in refused.err


def test_a_scenario_that_overrides_the_plan_s_is_recorded(run: Run, plan: Path, tmp_path: Path) -> None:
    assert run("run", plan, "--scenario", "authors-areas", "-o", tmp_path / "x.mcap").code == 0
    [started] = [event for event in logged(tmp_path / "x.mcap") if isinstance(event, RunStarted)]
    assert started.plan["problem"]["name"] == "authors-areas"


def test_a_plan_may_be_called_like_its_problem(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cell.json").write_text((SCENARIO_FOLDER / "machine-tending.json").read_text())
    assert run("plan", "cell.json", "--random", 1, "-o", "plans").code == 0
    (tmp_path / "plans" / "plan-001.json").rename(tmp_path / "plans" / "cell.json")
    assert run("run", "plans/cell.json", "-o", "x.mcap").code == 0


def test_a_problem_s_name_that_no_file_can_have_is_gone(run: Run, plan: Path, tmp_path: Path) -> None:
    values = json.loads(plan.read_text()) | {"problem": {"name": "x" * 5000}}
    plan.write_text(json.dumps(values))
    refused = run("run", plan, "-o", tmp_path / "x.mcap")
    assert refused.code == 1
    assert "which is no scenario, and no file" in refused.err
