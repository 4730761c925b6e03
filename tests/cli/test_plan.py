"""`hrclog plan`: plans found, judged, drawn, and planned anew from logs."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import hrclog
from hrclog.event_rows import from_row
from hrclog.events import Event, Outcome, TaskEnded, TaskStarted
from hrclog.log.messages.encode import event_message
from hrclog.log.reader import read_events
from hrclog.log.writing.journal import Journal
from hrclog.log.writing.writer import write_log
from hrclog.planning.plan import check_plan, read_plan, write_plan
from hrclog.planning.problem import Problem
from hrclog.planning.run_state import run_state
from hrclog.sim.run import plan_of, simulate_run
from hrclog.sim.scenario import load_scenario

Run = Callable[..., Any]

PAPER = load_scenario("paper")
KITTING = load_scenario("kitting")


@pytest.fixture(scope="module")
def kb(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a knowledge base of ten runs of the paper's cell."""
    from hrclog.cli import main

    folder = tmp_path_factory.mktemp("kb")
    for index in range(10):
        write_log(folder / f"{index}.mcap", simulate_run(PAPER, 4, index).events)
    assert (
        main(["kb", "update", *(str(path) for path in folder.glob("*.mcap")), "--kb", str(folder / "kb.sqlite")]) == 0
    )
    return folder / "kb.sqlite"


def guessed(scenario: Any = KITTING, **changes: dict[str, Any]) -> dict[str, Any]:  # noqa: ANN401 - a scenario
    """Return a scenario's problem as JSON, with a guess for every task; changes are of tasks by name."""
    problem = scenario.problem.to_json()
    guesses: dict[str, dict[str, float]] = {}
    for work in scenario.works:
        guesses.setdefault(work.task, {})[work.agent] = work.time.mean_s
    tasks = [t | {"expected_s": guesses.get(t["name"], {})} | changes.get(t["name"], {}) for t in problem["tasks"]]
    return dict(problem) | {"tasks": tasks}


@pytest.fixture
def problem(tmp_path: Path) -> Path:
    """Return the file of a problem with guesses."""
    path = tmp_path / "problem.json"
    path.write_text(json.dumps(guessed()))
    return path


def solve(problem: Problem, path: Path) -> None:
    check_plan(problem, read_plan(path))


def test_a_plan_is_found_by_what_was_learnt(run: Run, kb: Path, tmp_path: Path) -> None:
    result = run("plan", "paper", "--kb", kb, "--show", "-o", tmp_path / "monday.json")
    assert (result.code, result.err) == (0, "")
    assert result.out.startswith("monday: expected ")
    assert "less than the" in result.out
    assert "method enumerate, the best of all 225 plans" in result.out
    assert "kept apart" in result.out
    assert "human  |" in result.out
    assert "90 % of ends s" in result.out
    solve(PAPER.problem, tmp_path / "monday.json")
    assert run("run", tmp_path / "monday.json", "--mode", "timed", "-o", tmp_path / "run").code == 0


def test_the_knowledge_base_may_be_named_by_the_environment(
    run: Run, kb: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = run("plan", "paper", "--kb", kb).out
    monkeypatch.setenv("HRCLOG_KB", str(kb))
    assert run("plan", "paper").out == given


def test_the_same_seed_gives_the_same_json(run: Run, kb: Path) -> None:
    one, same, other = (run("plan", "paper", "--kb", kb, "--seed", seed, "--json") for seed in (3, 3, 4))
    assert one.out == same.out != other.out
    found = json.loads(one.out, parse_constant=pytest.fail)
    assert found["plan"]["items"]
    assert (found["guessed"], found["method"]) == ([], "enumerate")


@pytest.mark.slow
@pytest.mark.parametrize("method", ["enumerate", "local", "baseline", "not-neighboring", "random"])
@pytest.mark.parametrize("objective", ["mean", "p95", "closed-form"])
def test_every_method_and_objective_gives_a_plan(
    method: str, objective: str, run: Run, problem: Path, tmp_path: Path
) -> None:
    arguments = ("--method", method, "--objective", objective, "--effort", 300, "-o", tmp_path / "x.json", "--json")
    found = json.loads(run("plan", problem, *arguments).out, parse_constant=pytest.fail)
    assert (found["method"], found["objective"]) == (method, objective)
    solve(KITTING.problem, tmp_path / "x.json")
    assert read_plan(tmp_path / "x.json").to_json() == found["plan"]


@pytest.mark.slow
def test_constraint_programming_stops_in_time(run: Run, problem: Path) -> None:
    found = run("plan", problem, "--method", "cpsat", "--seconds", 5, "--json").json()
    assert found["bound_s"] <= found["forecast"]["undisturbed_s"] + 1e-6


def test_a_plan_may_be_made_by_guesses_alone_which_are_named(run: Run, problem: Path) -> None:
    result = run("plan", problem)
    assert result.code == 0
    assert "guessed, no run shows it succeed yet: take_part by operator, " in result.out
    assert "side by side in this plan, and no run tells a factor yet: " in result.out
    assert ["operator", "take_part"] in run("plan", problem, "--json").json()["guessed"]


def test_factors_may_be_supposed(run: Run, kb: Path, tmp_path: Path) -> None:
    file = tmp_path / "synergies.json"
    pair = {"agent": "robot", "task": "pick_orange_box", "other_agent": "human", "other_task": "pick_white_box"}
    file.write_text(json.dumps({"synergies": [pair | {"synergy": 6.0}]}))
    base = run("plan", "paper", "--kb", kb, "--json").json()
    found = run("plan", "paper", "--kb", kb, "--synergy", file, "--json").json()
    assert found["forecast"]["mean_s"] > base["forecast"]["mean_s"] + 3
    assert found["pairs"][0]["task"] == "pick_white_box"
    assert found["pairs"][0]["other_task"] == "pick_orange_box"
    file.write_text(json.dumps({"synergies": [pair | {"synergy": 6.0, "task": "dance"}]}))
    result = run("plan", "paper", "--kb", kb, "--synergy", file)
    assert result.code == 1
    assert "synergy of 'dance' by 'robot': nothing is known of it" in result.err


def test_pairs_may_be_kept_apart(run: Run, kb: Path, tmp_path: Path) -> None:
    file = tmp_path / "pairs.json"
    pair = {"agent": "robot", "task": "pick_blue_box", "other_agent": "human", "other_task": "pick_white_box"}
    file.write_text(json.dumps({"pairs": [pair]}))
    arguments = ("plan", "paper", "--kb", kb, "--method", "not-neighboring", "--json")
    found = run(*arguments, "--avoid", file).json()["pairs"]
    [beside] = [one for one in found if (one["task"], one["other_task"]) == ("pick_white_box", "pick_blue_box")]
    assert beside["overlap_s"] < 0.5 * beside["usual_overlap_s"]
    assert run("plan", "paper", "--kb", kb, "--avoid", file).code == 2
    file.write_text(json.dumps({"pairs": [pair | {"task": "dance"}]}))
    result = run(*arguments, "--avoid", file)
    assert result.code == 1
    assert "pairs to avoid: found 'dance' by 'robot'" in result.err


@pytest.mark.slow
def test_exploring_is_by_seed(run: Run, problem: Path) -> None:
    plans = [run("plan", problem, "--explore", "--seed", seed, "--json").json()["plan"] for seed in (1, 1, 2, 3, 4)]
    assert plans[0] == plans[1]
    orders = {json.dumps([(i["agent"], i["task"]) for i in plan["items"]]) for plan in plans}
    assert len(orders) > 1


def test_a_given_plan_is_judged(run: Run, kb: Path, tmp_path: Path) -> None:
    write_plan(tmp_path / "mine.json", plan_of(PAPER, 1, 2))
    result = run(
        "plan", "paper", "--kb", kb, "--judge", tmp_path / "mine.json", "--show", "-o", tmp_path / "timed.json"
    )
    assert result.code == 0
    assert result.out.startswith(f"{plan_of(PAPER, 1, 2).name}: expected ")
    assert "90 % of ends s" in result.out
    timed = read_plan(tmp_path / "timed.json")
    assert timed.orders() == plan_of(PAPER, 1, 2).orders()
    found = run("plan", "paper", "--kb", kb, "--judge", tmp_path / "mine.json", "--json").json()
    assert found["plan"] == timed.to_json()
    assert found["forecast"]["run_p05_s"] < found["forecast"]["mean_s"] < found["forecast"]["run_p95_s"]
    other = run("plan", "kitting", "--kb", kb, "--judge", tmp_path / "mine.json")
    assert other.code == 1
    assert other.err.startswith("hrclog: error: ")


# the rest of a run


def events_of(number: int = 0) -> list[Event]:
    return list(simulate_run(PAPER, 9, number).events)


@pytest.mark.parametrize("count", [2, 13, 40])
def test_a_run_that_broke_off_is_planned_to_its_end(count: int, run: Run, kb: Path, tmp_path: Path) -> None:
    events = events_of()[:count]
    write_log(tmp_path / "part.mcap", events)
    result = run("plan", "paper", "--kb", kb, "--from", tmp_path / "part.mcap", "-o", tmp_path / "rest.json", "--show")
    assert result.code in (0, 3)
    done = [event.item_id for event in events if isinstance(event, TaskEnded)]
    assert f"part.mcap: {len(done)} items done, " in result.out
    rest = read_plan(tmp_path / "rest.json")
    check_plan(PAPER.problem, rest)
    assert set(done) <= {item.item_id for item in rest.items}
    for agent, under_way in run_state(events).running.items():
        assert next(i.item_id for i in rest.queue(agent) if i.item_id not in done) == under_way.item_id


def test_what_is_excluded_from_a_run_is_still_to_be_done(run: Run, kb: Path, tmp_path: Path) -> None:
    events = events_of()[:13]
    write_log(tmp_path / "part.mcap", events)
    ended = [event for event in events if isinstance(event, TaskEnded)]
    hrclog.annotate(tmp_path / "part.mcap", exclude=ended[-1].execution_id, reason="the button was pressed by mistake")
    result = run("plan", "paper", "--kb", kb, "--from", tmp_path / "part.mcap", "-o", tmp_path / "rest.json")
    assert f"part.mcap: {len(ended) - 1} items done, " in result.out
    assert "[excluded]" in result.err


def test_a_failure_is_planned_for_and_told_as_json(run: Run, kb: Path, tmp_path: Path) -> None:
    from dataclasses import replace

    events = events_of()
    place = next(n for n, e in enumerate(events) if isinstance(e, TaskEnded) and e.task == "pick_blue_box")
    events[place] = replace(events[place], outcome=Outcome.FAILED)  # type: ignore[call-arg] - it is a TaskEnded
    write_log(tmp_path / "failed.mcap", events[: place + 1])
    result = run("plan", "paper", "--kb", kb, "--from", tmp_path / "failed.mcap", "--json")
    told = json.loads(result.out, parse_constant=pytest.fail)
    assert told["changed"] is True
    assert told["now_s"] == pytest.approx((events[place].time_ns - events[0].time_ns) / 1e9)
    failed = events[place]
    assert isinstance(failed, TaskEnded)
    assert failed.item_id not in {item["item_id"] for item in told["plan"]["items"]}
    assert told["forecast"]["mean_s"] > told["now_s"]


def test_a_run_that_is_over_needs_no_other_plan(run: Run, kb: Path, tmp_path: Path) -> None:
    write_log(tmp_path / "whole.mcap", events_of())
    result = run("plan", "paper", "--kb", kb, "--from", tmp_path / "whole.mcap", "-o", tmp_path / "same.json")
    assert result.code == 0
    assert "24 items done, 0 under way" in result.out
    assert "nothing is left to plan" in result.out
    assert read_plan(tmp_path / "same.json") == run_state(events_of()).plan
    told = run("plan", "paper", "--kb", kb, "--from", tmp_path / "whole.mcap", "--json").json()
    assert (told["changed"], told["forecast"]) == (False, None)


def test_the_log_of_another_cell_is_refused(run: Run, kb: Path, tmp_path: Path) -> None:
    write_log(tmp_path / "other.mcap", simulate_run(KITTING, 1, 0).events)
    result = run("plan", "paper", "--kb", kb, "--from", tmp_path / "other.mcap")
    assert result.code == 1
    assert "'add_screws' by 'operator'" in result.err
    assert "name its cell" in result.err


def test_a_single_possible_plan_is_neither_shorter_nor_longer_than_a_random_one(run: Run, tmp_path: Path) -> None:
    task = {"name": "pick", "agents": ["A"], "expected_s": 5.0}
    only = {"agents": ["A"], "tasks": [task], "counts": [{"task": "pick", "count": 2}]}
    (tmp_path / "only.json").write_text(json.dumps(only))
    result = run("plan", tmp_path / "only.json", "--seed", "-1")
    assert result.code == 0
    assert "0.0 % less than" in result.out
    assert "the only plan there is" in result.out


def test_too_many_plans_are_not_listed_and_a_limit_of_time_is_kept(run: Run, problem: Path, tmp_path: Path) -> None:
    many = json.loads(problem.read_text())
    many["counts"] = [count | {"count": 40} for count in many["counts"]]
    many["tasks"] = [{key: value for key, value in task.items() if key != "targets"} for task in many["tasks"]]
    (tmp_path / "many.json").write_text(json.dumps(many))
    result = run("plan", tmp_path / "many.json", "--method", "enumerate", "--seconds", "1")
    assert (result.code, result.err.count("\n")) == (1, 1)
    assert "too many to judge them all" in result.err
    result = run("plan", tmp_path / "many.json", "--method", "cpsat", "--seconds", "1")
    assert "choose local search" in result.err


def test_the_journal_of_a_run_that_goes_on_is_read(run: Run, kb: Path, tmp_path: Path) -> None:
    events = events_of()
    last = [n for n, event in enumerate(events) if isinstance(event, TaskStarted)][11]
    journal = Journal(tmp_path / "now.mcap.partial")
    for event in events[: last + 1]:
        journal.append(event_message(event, event.time_ns))
    result = run("plan", "paper", "--kb", kb, "--from", tmp_path / "now.mcap.partial", "--json")
    assert result.json()["plan"]["items"]
    assert result.json()["now_s"] == pytest.approx((events[last].time_ns - events[0].time_ns) / 1e9)
    missing = run("plan", "paper", "--kb", kb, "--from", tmp_path / "now.mcap")
    assert missing.code == 1
    assert "hrclog recover" in missing.err


def test_several_runs_in_one_log_are_too_many(run: Run, kb: Path, tmp_path: Path) -> None:
    write_log(tmp_path / "two.mcap", [*events_of(0), *events_of(1)])
    result = run("plan", "paper", "--kb", kb, "--from", tmp_path / "two.mcap")
    assert result.code == 1
    assert "two.mcap: found 2 runs, expected the log of one; hrclog info lists them" in result.err


def test_a_log_without_a_plan_has_no_rest(run: Run, kb: Path, tmp_path: Path, samples: Path) -> None:
    from dataclasses import replace

    first, *others = events_of()
    write_log(tmp_path / "free.mcap", [replace(first, plan=None), *others])  # type: ignore[call-arg] - it is a RunStarted
    result = run("plan", "paper", "--kb", kb, "--from", tmp_path / "free.mcap")
    assert result.code == 1
    assert "the run has no plan" in result.err
    other = run("plan", "kitting", "--kb", kb, "--from", next((samples / "campaign").glob("*.mcap")))
    assert other.code == 1
    assert other.err.count("\n") == 1


# random plans, and what cannot be done


def test_random_plans_are_of_the_problem(run: Run, problem: Path, tmp_path: Path) -> None:
    result = run("plan", problem, "--random", 3, "--seed", 2, "-o", tmp_path / "plans")
    assert (result.code, result.out) == (
        0,
        f"3 plans of {problem}: {tmp_path}/plans/plan-001.json .. plan-003.json\n",
    )
    for path in (tmp_path / "plans").iterdir():
        solve(KITTING.problem, path)


@pytest.mark.parametrize("arguments", [("plan",), ("plan", "paper", "--random", 2), ("plan", "paper", "--effort", 5)])
def test_what_is_asked_wrongly_is_a_usage_error(arguments: tuple[Any, ...], run: Run) -> None:
    assert run(*arguments).code == 2


def test_one_thing_is_asked_at_a_time(run: Run, tmp_path: Path) -> None:
    result = run("plan", "paper", "--random", 2, "--judge", "x", "--from", "y", "-o", tmp_path / "p")
    assert result.code == 2
    assert "--random and --judge and --from ask for different things" in result.err


def test_nothing_is_overwritten(run: Run, problem: Path, tmp_path: Path) -> None:
    (tmp_path / "x.json").write_text("mine")
    for more in ((), ("--json",)):
        result = run("plan", problem, "-o", tmp_path / "x.json", *more)
        assert result.code == 1
        assert "x.json: exists already" in result.err
    assert (tmp_path / "x.json").read_text() == "mine"


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"take_part": {"due_s": 0.5}}, "task 'take_part': due_s is 0.5, "),
        ({"take_part": {"expected_s": {}}}, "how long does it take: take_part by operator?"),
        ({"take_part": {"expected_s": {"operator": -1}}}, "expected_s"),
        ({"take_part": {"agents": []}}, "take_part"),
    ],
)
def test_a_problem_that_cannot_be_planned_is_told_in_one_line(
    changes: dict[str, Any], told: str, run: Run, tmp_path: Path
) -> None:
    path = tmp_path / "problem.json"
    path.write_text(json.dumps(guessed(**changes)))
    result = run("plan", path)
    assert (result.code, result.out) == (1, "")
    assert result.err.startswith("hrclog: error: ")
    assert told in result.err
    assert result.err.count("\n") == 1


@pytest.mark.parametrize(
    ("option", "text"),
    [
        ("--synergy", "{"),
        ("--synergy", '{"synergies": [{}]}'),
        ("--avoid", '{"synergies": []}'),
        ("--judge", "[]"),
        ("--from", "no log"),
        ("--kb", "no knowledge"),
    ],
)
def test_a_file_that_is_something_else_is_told_in_one_line(
    option: str, text: str, run: Run, problem: Path, tmp_path: Path
) -> None:
    path = tmp_path / "odd"
    method = ("--method", "not-neighboring") if option == "--avoid" else ()
    for exists in (False, True):
        if exists:
            path.write_text(text)
        result = run("plan", problem, option, path, *method)
        assert (result.code, result.out) == (1, "")
        assert str(path) in result.err
        assert result.err.count("\n") == 1


@pytest.mark.parametrize(
    ("text", "problems"),
    [("{", 1), ("[]", 1), ('{"agents": []}', 2), ('{"problem": 3}', 3), ('{"nonsense": 1}', 4)],
)
def test_all_that_is_wrong_with_a_problem_is_told_at_once(text: str, problems: int, run: Run, tmp_path: Path) -> None:
    path = tmp_path / "odd.json"
    path.write_text(text)
    result = run("plan", path)
    assert (result.code, result.out) == (1, "")
    assert result.err.startswith(f"hrclog: error: {path}: ")
    assert result.err.count("\n") == (1 if problems == 1 else 1 + problems)
    assert result.err.count("Traceback") == 0
    assert run("plan", tmp_path / "nowhere").code == 1
    assert "the names are " in run("plan", "papre").err


def test_a_scenario_s_file_is_a_problem_too(run: Run, kb: Path, tmp_path: Path) -> None:
    from hrclog.sim.scenario import SCENARIO_FOLDER

    path = tmp_path / "mine.json"
    path.write_text((SCENARIO_FOLDER / "paper.json").read_text())
    assert run("plan", path, "--kb", kb).out == run("plan", "paper", "--kb", kb).out


def test_what_is_read_of_a_log_is_what_was_written(tmp_path: Path) -> None:
    events = events_of()
    write_log(tmp_path / "x.mcap", events)
    assert [from_row(row) for row in read_events(tmp_path / "x.mcap").iter_rows(named=True)][-1] == events[-1]


def test_a_plan_is_set_against_a_random_one(run: Run, kb: Path) -> None:
    text = run("plan", "paper", "--kb", kb).out
    mean_s = float(re.search(r"expected ([\d.]+) s", text)[1])  # type: ignore[index]  # else the test fails
    percent, usual_s = re.search(r"([\d.]+) % less than the ([\d.]+) s of a random plan", text).groups()  # type: ignore[union-attr]  # likewise
    assert float(percent) == pytest.approx(100 * (1 - mean_s / float(usual_s)), abs=0.15)
