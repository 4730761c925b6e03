"""Plans: what they hold, how they are read, and how a plan that solves nothing is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from hrclog.errors import ScenarioError
from hrclog.events import Role
from hrclog.planning.plan import (
    Arrival,
    Plan,
    PlanItem,
    check_plan,
    make_plan,
    read_plan,
    with_planned_times,
    write_plan,
)
from hrclog.planning.problem import Count, Precedence, PrecedenceKind, Problem, Task

CELL = Problem(
    ("H", "R"),
    (Task("pick", ("R",)), Task("place", ("R",)), Task("screw", ("H",)), Task("pack", ("H", "R"))),
    (Count("pick", 2, "R"), Count("place", 2, "R"), Count("screw", 2), Count("pack", 1)),
    (
        Precedence("pick", "place"),
        Precedence("place", "screw", PrecedenceKind.EACH),
        Precedence("screw", "pack", PrecedenceKind.ALL),
    ),
)
ORDERS = {"H": ("screw", "screw", "pack"), "R": ("pick", "place", "pick", "place")}


@pytest.fixture
def plan() -> Plan:
    return make_plan(CELL, ORDERS, "good")


def test_items_wait_for_what_the_precedences_ask_for(plan: Plan) -> None:
    waits = {item.item_id: item.after for item in plan.items}
    assert waits == {
        "R-01": (),
        "R-02": ("R-01",),
        "R-03": (),
        "R-04": ("R-03",),
        "H-01": ("R-02",),
        "H-02": ("R-04",),
        "H-03": ("H-01", "H-02"),
    }


def test_items_stand_in_an_order_that_is_possible(plan: Plan) -> None:
    places = {item.item_id: place for place, item in enumerate(plan.items)}
    assert all(places[other] < places[item.item_id] for item in plan.items for other in item.after)
    assert plan.orders() == ORDERS


def test_a_made_plan_solves_its_problem(plan: Plan) -> None:
    check_plan(CELL, plan)


def test_a_plan_comes_back_from_its_file(plan: Plan, tmp_path: Path) -> None:
    timed = with_planned_times(plan, {(item.agent, item.task): 1.1 for item in plan.items}, {"H": 0.1})
    for number, written in enumerate((plan, timed)):
        path = tmp_path / f"{number}.json"
        write_plan(path, written)
        assert read_plan(path) == written
    assert len(list(tmp_path.iterdir())) == 2


def test_labels_facts_limits_and_arrivals_come_back_from_the_file(plan: Plan, tmp_path: Path) -> None:
    changes = {
        "R-01": {"meet": "hand over", "timeout_s": 4.0},
        "H-01": {"meet": "hand over"},
        "H-03": {"needs": ("crate", "label")},
    }
    items = tuple(replace(item, **changes.get(item.item_id, {})) for item in plan.items)  # type: ignore[arg-type] - fields of an item
    written = Plan("rich", items, (Arrival("crate", 2.5), Arrival("label", 0.0)))
    write_plan(tmp_path / "rich.json", written)
    assert read_plan(tmp_path / "rich.json") == written
    assert with_planned_times(written, {(i.agent, i.task): 1.0 for i in items}).arrivals == written.arrivals


def test_a_plan_without_labels_facts_and_limits_does_not_name_them(plan: Plan) -> None:
    assert set(plan.to_json()) == {"schema_version", "name", "items"}
    assert set().union(*plan.to_json()["items"]) == {"item_id", "agent", "task", "after"}


def test_auxiliary_tasks_without_a_count_may_stand_anywhere_but_between_what_must_follow(plan: Plan) -> None:
    home = Task("go_home", ("R",), role=Role.AUXILIARY)
    cell = replace(CELL, tasks=(*CELL.tasks, home))
    check_plan(cell, plan)
    orders = {"H": ORDERS["H"], "R": ("go_home", "pick", "place", "go_home", "pick", "place", "go_home")}
    check_plan(cell, make_plan(cell, orders))
    with pytest.raises(ScenarioError, match="'R' cannot do 'go_home' before 'place'"):
        make_plan(cell, orders | {"R": ("pick", "go_home", "place", "pick", "place")})
    counted = replace(cell, counts=(*CELL.counts, Count("go_home", 1)))
    with pytest.raises(ScenarioError, match="'go_home' is done 3 times, expected 1"):
        make_plan(counted, orders)


def test_primary_tasks_without_a_count_are_not_to_be_done() -> None:
    cell = replace(CELL, tasks=(*CELL.tasks, Task("wave", ("R",))))
    with pytest.raises(ScenarioError, match="'wave' is done 1 time, expected 0"):
        make_plan(cell, ORDERS | {"R": ("wave", *ORDERS["R"])})


LATER = replace(CELL, tasks=(replace(CELL.tasks[0], release_s=7.0), *CELL.tasks[1:]))


def test_items_of_a_task_that_is_released_later_need_a_fact_that_arrives_then() -> None:
    plan = make_plan(LATER, ORDERS)
    assert {item.item_id: item.needs for item in plan.items if item.needs} == {
        "R-01": ("released: pick",),
        "R-03": ("released: pick",),
    }
    assert plan.arrivals == (Arrival("released: pick", 7.0),)
    check_plan(LATER, plan)


def test_planned_times_keep_to_what_arrives() -> None:
    timed = with_planned_times(make_plan(LATER, ORDERS), dict.fromkeys(LATER.agent_tasks(), 1.0), {"R": 0.5})
    assert [item.planned_start_s for item in timed.queue("R")] == [7.5, 9.0, 10.5, 12.0]


def test_an_item_that_does_not_wait_for_its_release_is_found() -> None:
    plan = make_plan(LATER, ORDERS)
    hasty = tuple(replace(i, needs=()) if i.item_id == "R-03" else i for i in plan.items)
    with pytest.raises(ScenarioError, match="item 'R-03' does not need 'released: pick'; add it"):
        check_plan(LATER, replace(plan, items=hasty))
    with pytest.raises(ScenarioError, match="fact 'released: pick' never arrives; let it arrive at 7 s"):
        check_plan(LATER, replace(plan, arrivals=()))
    with pytest.raises(ScenarioError, match="fact 'released: pick' arrives at 3 s; let it arrive at 7 s"):
        check_plan(LATER, replace(plan, arrivals=(Arrival("released: pick", 3.0),)))


@pytest.mark.parametrize("agents", [("R", "R"), ("H",), ("H", "R", "R")])
def test_a_meeting_has_one_item_each_of_two_or_more_agents(agents: tuple[str, ...], plan: Plan) -> None:
    wanted = list(agents)
    items = []
    for item in plan.items:
        meets = item.agent in wanted
        if meets:
            wanted.remove(item.agent)
        items.append(replace(item, meet="lift" if meets else ""))
    with pytest.raises(ScenarioError, match=r"meet 'lift' stands at items of .*expected one item each of two or more"):
        check_plan(CELL, Plan("met", tuple(items)))


def test_planned_times_follow_from_gaps_order_and_precedence(plan: Plan) -> None:
    durations = {("R", "pick"): 2.0, ("R", "place"): 3.0, ("H", "screw"): 10.0, ("H", "pack"): 1.0}
    timed = with_planned_times(plan, durations, {"R": 0.5})
    times = {item.item_id: (item.planned_start_s, item.planned_end_s) for item in timed.items}
    assert times == {
        "R-01": (0.5, 2.5),
        "R-02": (3.0, 6.0),
        "R-03": (6.5, 8.5),
        "R-04": (9.0, 12.0),
        "H-01": (6.0, 16.0),
        "H-02": (16.0, 26.0),
        "H-03": (26.0, 27.0),
    }


@pytest.mark.parametrize(
    ("orders", "message"),
    [
        ({"H": ("screw", "pack"), "R": ORDERS["R"]}, "'screw' is done 1 time, expected 2"),
        (
            {"H": ("pick", "screw", "screw", "pack"), "R": ("place", "pick", "place")},
            "'H' cannot do 'pick', only R can",
        ),
        ({"H": ORDERS["H"], "R": ("pick", "pick", "place", "place")}, "'R' cannot do 'pick' before 'place'"),
        (
            {"H": ORDERS["H"], "R": ("place", "pick", "pick", "place")},
            r"'R' cannot do 'place' without 'pick' before it",
        ),
        (
            {"H": ("pack", "screw", "screw"), "R": ORDERS["R"]},
            r"'H' cannot do 'pack' without 'screw' before it \(all\)",
        ),
        ({"H": ORDERS["H"], "R": ORDERS["R"], "X": ("screw",)}, "'X' cannot do 'screw'"),
        ({"H": ("screw", "weld"), "R": ()}, "task 'weld': unknown"),
    ],
)
def test_an_impossible_order_is_refused(orders: dict[str, tuple[str, ...]], message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        make_plan(CELL, orders)


def test_each_agent_has_its_own_counts() -> None:
    cell = Problem(("H", "R"), (Task("pick", ("H", "R")),), (Count("pick", 1, "H"), Count("pick", 1, "R")))
    with pytest.raises(ScenarioError, match="'R' does 'pick' 0 times, expected 1"):
        make_plan(cell, {"H": ("pick", "pick")})


def test_an_order_that_works_only_if_the_right_agent_goes_first_is_found() -> None:
    rule = (Precedence("a", "b", PrecedenceKind.EACH),)
    cell = Problem(("X", "Y"), (Task("a", ("X", "Y")), Task("b", ("X", "Y"))), (Count("a", 2), Count("b", 2)), rule)
    plan = make_plan(cell, {"X": ("a", "b"), "Y": ("b", "a")})  # Y must take the first part, or nobody makes a second
    assert [item.item_id for item in plan.items] == ["X-01", "Y-01", "Y-02", "X-02"]
    check_plan(cell, plan)


def _without_wait(plan: Plan, item_id: str) -> Plan:
    return Plan(plan.name, tuple(replace(i, after=()) if i.item_id == item_id else i for i in plan.items))


@pytest.mark.parametrize(("item_id", "kind"), [("R-02", "next"), ("H-02", "each"), ("H-03", "all")])
def test_an_item_that_does_not_wait_is_found(plan: Plan, item_id: str, kind: str) -> None:
    with pytest.raises(ScenarioError, match=rf"item '{item_id}' breaks the precedence .*\({kind}\)"):
        check_plan(CELL, _without_wait(plan, item_id))


def test_an_item_that_waits_for_some_only_of_all_is_found(plan: Plan) -> None:
    partly = tuple(replace(i, after=("H-01",)) if i.item_id == "H-03" else i for i in plan.items)
    with pytest.raises(ScenarioError, match=r"item 'H-03' breaks the precedence screw -> pack \(all\)"):
        check_plan(CELL, Plan("partly", partly))


def test_two_items_may_not_wait_for_the_same_hand_over(plan: Plan) -> None:
    doubled = tuple(replace(i, after=("R-02",)) if i.item_id == "H-02" else i for i in plan.items)
    with pytest.raises(ScenarioError, match="item 'H-02' breaks the precedence place -> screw"):
        check_plan(CELL, Plan("doubled", doubled))


def test_what_must_follow_at_once_may_not_wait_for_an_earlier_one() -> None:
    items = (
        PlanItem("1", "R", "pick"),
        PlanItem("2", "R", "pick"),
        PlanItem("3", "R", "place", ("1",)),
        PlanItem("4", "R", "place", ("2",)),
    )
    cell = Problem(("R",), CELL.tasks[:2], CELL.counts[:2], CELL.precedences[:1])
    cell = replace(cell, tasks=tuple(replace(task, agents=("R",)) for task in cell.tasks))
    with pytest.raises(ScenarioError, match="item '3' breaks the precedence pick -> place"):
        check_plan(cell, Plan("late", items))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not JSON"),
        ("[]", r"found '\[\]', expected a JSON object"),
        ("{}", "'items' is missing"),
        ('{"items": [], "extra": 1}', "unknown field 'extra'"),
        ('{"schema_version": 99, "items": []}', "found '99', expected at most 1"),
        ('{"items": [], "arrivals": [{"fact": "part"}]}', r"arrivals\[0\]: 'at_s' is missing"),
        ('{"items": [], "arrivals": [{"fact": "part", "at_s": -1}]}', "at_s: found '-1', expected a number from 0"),
        (
            '{"items": [{"item_id": "1", "agent": "H", "task": "a", "needs": "part"}]}',
            "needs: found 'part', expected a list of texts",
        ),
        (
            '{"items": [{"item_id": "1", "agent": "H", "task": "a", "timeout_s": 0}]}',
            "timeout_s: found '0', expected a number above 0",
        ),
        (
            '{"items": [{"item_id": "1", "agent": "H", "task": "a", "meet": "x"}]}',
            "meet 'x' stands at items of 'H', expected one item each",
        ),
        ('{"items": [{"item_id": "1", "agent": "H"}]}', r"items\[0\]: 'task' is missing"),
        ('{"items": [{"item_id": "1", "agent": "H", "task": "a", "planned_start_s": NaN}]}', "NaN is no JSON number"),
        ('{"items": [{"item_id": "1", "agent": "H", "task": "a", "planned_start_s": -1}]}', "expected a number from 0"),
        (
            '{"items": [{"item_id": "1", "agent": "H", "task": "a", "planned_start_s": 2, "planned_end_s": 1}]}',
            "expected at least planned_start_s = 2",
        ),
        (
            '{"items": [{"item_id": "1", "agent": "H", "task": "a", "after": ["2"]}]}',
            r"items\[0\] '1' waits for '2', which does not come before it",
        ),
        (
            '{"items": [{"item_id": "1", "agent": "H", "task": "a"}, {"item_id": "1", "agent": "H", "task": "a"}]}',
            r"items\[1\] '1' has an id used before",
        ),
    ],
)
def test_a_bad_plan_file_is_named_with_the_place(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    path.write_text(text)
    with pytest.raises(ScenarioError, match=message) as caught:
        read_plan(path)
    assert str(path) in str(caught.value)


def test_a_missing_plan_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"none.json: cannot be read .*expected a plan"):
        read_plan(tmp_path / "none.json")
