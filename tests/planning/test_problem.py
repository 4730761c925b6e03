"""What may be asked of a cell, and how impossible wishes are refused."""

from __future__ import annotations

from dataclasses import replace

import pytest

from hrclog.errors import ScenarioError
from hrclog.events import Role
from hrclog.json_record import JsonRecord
from hrclog.planning.dispatch_mode import DispatchMode
from hrclog.planning.problem import (
    Count,
    Precedence,
    PrecedenceKind,
    Problem,
    Task,
    Unit,
)
from hrclog.planning.problem_json import PROBLEM_FIELDS, problem_from_json

BOTH = ("human", "robot")
PICK, PLACE = Task("pick", BOTH, "pick"), Task("place", BOTH, "place")
GOOD = Problem(
    BOTH, (PICK, PLACE), (Count("pick", 2, "human"), Count("place", 2, "human")), (Precedence("pick", "place"),)
)


def test_a_problem_comes_back_from_json_as_it_was() -> None:
    problem = replace(GOOD, tasks=(replace(PICK, targets=("a", "b")), PLACE))
    assert problem_from_json(JsonRecord(problem.to_json(), "x", PROBLEM_FIELDS)) == problem


def test_only_auxiliary_tasks_say_their_role_in_json() -> None:
    problem = replace(GOOD, tasks=(*GOOD.tasks, Task("go_home", ("robot",), role=Role.AUXILIARY)))
    assert problem_from_json(JsonRecord(problem.to_json(), "x", PROBLEM_FIELDS)) == problem
    assert [task.get("role") for task in problem.to_json()["tasks"]] == [None, None, "auxiliary"]


def test_what_planners_know_of_a_task_comes_back_from_json_and_is_left_out_where_nothing_is_said() -> None:
    fixed = replace(PICK, resources=("fixture", "tool"), release_s=5.0, due_s=60.0, expected_s={"human": 4.5})
    problem = replace(GOOD, tasks=(fixed, PLACE))
    assert problem_from_json(JsonRecord(problem.to_json(), "x", PROBLEM_FIELDS)) == problem
    said, unsaid = problem.to_json()["tasks"]
    assert set(said) - set(unsaid) == {"resources", "release_s", "due_s", "expected_s"}
    assert len({problem, GOOD}) == 2


def test_an_expected_duration_may_be_given_for_all_agents_at_once() -> None:
    record = GOOD.to_json()
    record["tasks"][0] |= {"expected_s": 4}
    problem = problem_from_json(JsonRecord(record, "x", PROBLEM_FIELDS))
    assert problem.task("pick").expected_s == {"human": 4.0, "robot": 4.0}


def test_what_comes_late_need_not_be_due_before_it_if_nothing_of_it_is_done() -> None:
    rule = Precedence("pick", "place", PrecedenceKind.ALL)
    tasks = (replace(PICK, release_s=9.0), replace(PLACE, due_s=5.0))
    Problem(BOTH, tasks, (Count("place", 1),), (rule,))
    with pytest.raises(ScenarioError, match="'pick', which is released at 9 s only"):
        Problem(BOTH, tasks, (Count("place", 1), Count("pick", 1)), (rule,))


def test_work_that_must_follow_is_one_unit_of_the_counted_agent() -> None:
    assert GOOD.units() == [Unit(("pick", "place"), ("human",))] * 2


def test_work_of_any_agent_may_go_to_every_agent_that_can_do_all_of_it() -> None:
    tasks = (PICK, Task("place", ("robot",)))
    counts = (Count("pick", 1), Count("place", 1))
    assert replace(GOOD, tasks=tasks, counts=counts).units() == [Unit(("pick", "place"), ("robot",))]


def test_agent_tasks_are_ordered_by_agent_then_task() -> None:
    assert GOOD.agent_tasks() == [(agent, task) for agent in BOTH for task in ("pick", "place")]


def test_an_unknown_task_is_refused_with_the_known_names() -> None:
    with pytest.raises(ScenarioError, match=r"task 'fly': unknown; the tasks are pick, place"):
        GOOD.task("fly")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"agents": ("human", "human")}, "agent 'human': named twice"),
        ({"agents": ("", "robot")}, "agent '': empty"),
        ({"agents": ("human",)}, "task 'pick': agent 'robot' is unknown; the agents are human"),
        ({"tasks": (PICK, PLACE, PICK)}, "task 'pick': named twice"),
        ({"tasks": (PICK, Task("place", ()))}, "task 'place': no agent can do it"),
        ({"tasks": (replace(PICK, targets=("a",)), PLACE)}, "task 'pick': 2 executions for 1 target"),
        ({"tasks": (replace(PICK, targets=("a", "a")), PLACE)}, "task 'pick': target 'a': named twice"),
        ({"tasks": (replace(PICK, resources=("jig", "jig")), PLACE)}, "task 'pick': resource 'jig': named twice"),
        ({"tasks": (replace(PICK, release_s=-1.0), PLACE)}, "'pick': release_s: found -1, expected a number from 0"),
        ({"tasks": (replace(PICK, release_s=float("nan")), PLACE)}, "'pick': release_s: found nan"),
        (
            {"tasks": (replace(PICK, release_s=9.0, due_s=9.0), PLACE)},
            "'pick': due_s: found 9, expected a number above its release_s = 9",
        ),
        (
            {"tasks": (replace(PICK, release_s=9.0), replace(PLACE, due_s=5.0))},
            "'place': due_s: found 5, but it comes after 'pick', which is released at 9 s only; change one",
        ),
        (
            {"tasks": (Task("pick", ("human",), expected_s={"robot": 1.0}), PLACE)},
            "'pick': expected_s: 'robot' cannot do it, only human can",
        ),
        (
            {"tasks": (replace(PICK, expected_s={"robot": 0.0}), PLACE)},
            "'pick': expected_s of 'robot': found 0, expected a number above 0",
        ),
        ({"counts": ()}, "nothing is to be done"),
        ({"counts": (Count("pick", 1, "human"), Count("pick", 1, "human"))}, "count of 'pick by human': named twice"),
        ({"counts": (Count("pick", -1, "human"), Count("place", 2, "human"))}, "count of 'pick': found -1"),
        ({"counts": (Count("pick", 1, "dog"),)}, "count of 'pick': agent 'dog' is unknown"),
        ({"tasks": (PICK, Task("place", ("robot",)))}, "count of 'place': 'human' cannot do it, only robot can"),
        ({"precedences": (Precedence("pick", "weld"),)}, "task 'weld': unknown"),
        (
            {"counts": (Count("pick", 2, "human"), Count("place", 3, "human"))},
            "human must do both equally often.* 2 and 3",
        ),
        (
            {"counts": (Count("pick", 1, "human"), Count("place", 1, "robot"))},
            "human must do both equally often.* 1 and 0",
        ),
        (
            {"precedences": (Precedence("pick", "place"), Precedence("place", "pick"))},
            "pick -> place -> pick is a cycle|place -> pick -> place is a cycle",
        ),
        ({"precedences": (Precedence("pick", "pick", PrecedenceKind.ALL),)}, "pick -> pick is a cycle"),
        (
            {
                "counts": (Count("pick", 1, "human"), Count("place", 2, "human")),
                "precedences": (Precedence("pick", "place", PrecedenceKind.EACH),),
            },
            "at least as many before; found 1 and 2",
        ),
    ],
)
def test_a_contradiction_is_named(change: dict[str, object], message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        replace(GOOD, **change)  # type: ignore[arg-type] # the wrong values are the point


def test_work_that_must_follow_needs_an_agent_that_can_do_both() -> None:
    with pytest.raises(ScenarioError, match="one agent must do both, and none can"):
        Problem(
            BOTH,
            (Task("pick", ("human",)), Task("place", ("robot",))),
            (Count("pick", 1), Count("place", 1)),
            (Precedence("pick", "place"),),
        )


def test_a_chain_of_three_needs_one_agent_for_all() -> None:
    tasks = (Task("a", ("human",)), Task("b", BOTH), Task("c", ("robot",)))
    chain = (Precedence("a", "b"), Precedence("b", "c"))
    with pytest.raises(ScenarioError, match="a -> b -> c: one agent must do all"):
        Problem(BOTH, tasks, tuple(Count(name, 1) for name in "abc"), chain)


def test_a_task_has_one_follower_only() -> None:
    tasks = (*GOOD.tasks, Task("drop", BOTH))
    with pytest.raises(ScenarioError, match="tasks that come next after 'pick': named twice"):
        replace(
            GOOD,
            tasks=tasks,
            counts=(*GOOD.counts, Count("drop", 2, "human")),
            precedences=(*GOOD.precedences, Precedence("pick", "drop")),
        )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"agents": "human"}, "cell: agents: found 'human', expected a list of texts"),
        ({"agent": []}, "cell: unknown field 'agent'; the fields are agents, counts, precedences, tasks"),
        ({"tasks": [{"agents": ["human"]}]}, r"cell: tasks\[0\]: 'name' is missing"),
        (
            {"tasks": [{"name": "pick", "agents": ["human"], "role": "extra"}]},
            r"tasks\[0\]: role: found 'extra', expected one of primary, auxiliary",
        ),
        (
            {"tasks": [{"name": "pick", "agents": ["human"], "expected_s": "long"}]},
            r"tasks\[0\]: expected_s: found 'long', expected a number above 0, or an object with one for each agent",
        ),
        (
            {"tasks": [{"name": "pick", "agents": ["human"], "expected_s": {"human": -1}}]},
            r"tasks\[0\]: expected_s: human: found '-1', expected a number above 0",
        ),
        (
            {"tasks": [{"name": "pick", "agents": ["human"], "resources": "jig"}]},
            r"tasks\[0\]: resources: found 'jig', expected a list of texts",
        ),
        (
            {"tasks": [{"name": "pick", "agents": ["human"], "due_s": -1}]},
            r"tasks\[0\]: due_s: found '-1', expected a number from 0",
        ),
        ({"tasks": ["pick"]}, r"cell: tasks\[0\]: found 'pick', expected a JSON object"),
        (
            {"counts": [{"task": "pick", "count": 1.5}]},
            r"cell: counts\[0\]: count: found '1.5', expected a whole number",
        ),
        ({"counts": [{"task": "pick", "count": True}]}, "found 'True', expected a whole number"),
        (
            {"precedences": [{"before": "pick", "after": "place", "kind": "soon"}]},
            "kind: found 'soon', expected one of next, each, all",
        ),
        ({"agents": ["human"]}, "cell: 2 problems\n  task 'pick': agent 'robot' is unknown"),
    ],
)
def test_a_wrong_field_is_named_with_its_place(change: dict[str, object], message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        problem_from_json(JsonRecord(GOOD.to_json() | change, "cell", PROBLEM_FIELDS))


def test_a_text_that_is_not_given_is_its_default_itself() -> None:
    """Ids of runs depend on how a dispatch mode is written out, so a member of an enumeration must stay one."""
    assert JsonRecord({}, "cell", ("mode",)).text("mode", DispatchMode.TIMED) is DispatchMode.TIMED
    modes = tuple(DispatchMode)
    assert JsonRecord({}, "cell", ("mode",)).choice("mode", modes, DispatchMode.TIMED) is DispatchMode.TIMED
