"""Which plan a run carried out: equal for equal orders, told apart otherwise, and by whom it was made."""

from __future__ import annotations

import json
from itertools import combinations
from typing import TYPE_CHECKING, Any

import polars as pl
import pytest
from event_frames import event, frame
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.analyzers.projections.plan_labels import CHANGED, plan_labels
from hrclog.analyzers.projections.schemas import PLAN_LABELS
from hrclog.planning.plan import Plan, PlanItem
from hrclog.recipe_names import planner_and_session

if TYPE_CHECKING:
    from conftest import Runs

AB = (("A", "x"), ("A", "y"), ("B", "z"))


def plan_json(items: tuple[tuple[str, str], ...], name: str = "") -> dict[str, Any]:
    """Return a plan as `hrclog sim` and `hrclog run` log it."""
    return Plan(name, tuple(PlanItem(f"i{n}", agent, task) for n, (agent, task) in enumerate(items))).to_json()


def labels(*facts: object, changed: tuple[int, ...] = ()) -> dict[str, tuple[str, str]]:
    """Return plan and planner of runs r0, r1, …, given what their `run_started` has in its details."""
    rows = [event("run_started", 0, run_id=f"r{n}", details=json.dumps(one)) for n, one in enumerate(facts)]
    rows += [event("plan_changed", 5, run_id=f"r{n}", details='{"plan":"other"}') for n in changed]
    found = plan_labels(frame(rows))
    assert found.schema == PLAN_LABELS
    return {run: (plan, planner) for run, plan, planner in found.iter_rows()}


def plans(*values: object) -> list[str]:
    return [plan for plan, _ in labels(*({"plan": value} for value in values)).values()]


def test_a_plan_is_known_by_its_name() -> None:
    assert plans(plan_json(AB, "first"), plan_json(AB[::-1], "second"), "by hand") == ["first", "second", "by hand"]


def test_plans_of_one_order_are_one_whatever_they_are_called() -> None:
    other_agent_first = (AB[2], *AB[:2])
    assert plans(plan_json(AB, "late"), plan_json(other_agent_first, "early")) == ["early", "early"]


def test_one_name_for_two_plans_is_told_apart() -> None:
    one, other, again = plans(plan_json(AB, "plan"), plan_json((AB[1], AB[0], AB[2]), "plan"), plan_json(AB, "plan"))
    assert one == again != other
    assert {one[:5], other[:5]} == {"plan "}


def test_plans_without_a_name_have_a_digest() -> None:
    one, other, listed = plans(plan_json(AB), plan_json(AB[:2]), plan_json(AB)["items"])
    assert one == listed != other
    assert one.startswith("plan ")
    assert len(one) == len("plan 3f2a")
    assert plans(plan_json(AB[:2])) == [other], "a digest does not depend on the other runs"


def test_a_run_that_changed_its_plan_is_apart() -> None:
    found = labels({"plan": "p"}, {"plan": "p"}, {}, changed=(1, 2))
    assert [plan for plan, _ in found.values()] == ["p", "p" + CHANGED, ""]


def test_the_planner_is_what_the_log_or_the_recipe_says() -> None:
    found = labels(
        {"planner": "said", "plan": {"planner": "cp-sat", "items": []}},
        {"plan": {"planner": "cp-sat", "items": []}},
        {"plan": {"method": "local search"}},
        {"name": "BASIC_SOLVER_rec_12_rep_0_2023_07_19_12:08_14", "source": "mongo"},
        {"name": "BASIC_SOLVER"},
        {"planner": 7, "name": ["x"]},
    )
    assert [planner for _, planner in found.values()] == ["said", "cp-sat", "local search", "BASIC_SOLVER", "", ""]


@pytest.mark.parametrize("name", ["", "BASIC", "P_rec_1_rep_2", "P_rec_x_rep_0_2023", "_rec_0_rep_0_x"])
def test_other_names_say_no_planner(name: str) -> None:
    assert planner_and_session(name) is None


@pytest.mark.parametrize("details", ["", "{", "[1]", '{"plan":null}', '{"plan":[]}', '{"plan":{}}', '{"plan":""}'])
def test_a_log_may_say_nothing(details: str) -> None:
    rows = [event("run_started", 0, details=details), event("task_started", 1, run_id="without")]
    assert plan_labels(frame(rows)).rows() == [("run", "", ""), ("without", "", "")]


def test_the_first_start_of_a_run_counts() -> None:
    segments = [event("run_started", n, details=f'{{"plan":"p{n}","segment":{n}}}') for n in (1, 2)]
    assert plan_labels(frame(segments)).rows() == [("run", "p1", "")]
    assert plan_labels(frame(segments).reverse()).rows() == [("run", "p1", "")]


items = st.lists(st.tuples(st.sampled_from("AB"), st.sampled_from("xy")), max_size=4).map(tuple)
values = st.one_of(
    st.builds(plan_json, items, st.sampled_from(["", "p", "q", "plan"])),
    st.sampled_from(["", "p", "q", None, 3, [1], {"a": 1}, {"name": "p"}, {"items": [{"agent": "A"}]}]),
)


@given(st.lists(values, max_size=6))
@settings(max_examples=60)
def test_labels_are_equal_just_where_plans_are(found: list[Any]) -> None:
    told = plans(*found)
    assert plans(*found[::-1]) == told[::-1]
    for (one, label), (other, other_label) in combinations(zip(found, told, strict=True), 2):
        if isinstance(one, dict) and isinstance(other, dict) and one.get("schema_version") and one["items"]:
            same = bool(other.get("schema_version")) and orders(one) == orders(other)
            assert (label == other_label) == same


def orders(plan: dict[str, Any]) -> dict[str, list[str]]:
    return {agent: [item["task"] for item in plan["items"] if item["agent"] == agent] for agent in "AB"}


def test_the_authors_planners_are_told(online: Runs, offline: Runs) -> None:
    found = plan_labels(online.events)
    assert dict(found.group_by("planner").len().iter_rows()) == {
        "BASIC_SOLVER": 50,
        "NOT_NEIGHBORING_TASKS": 50,
        "RELAXED_HA_SOLVER": 50,
        "COMPLETE_SOLVER": 50,
    }
    assert found["run_id"].is_sorted()
    assert set(found["plan"]) == {""}
    assert plan_labels(offline.events)["planner"].unique().to_list() == ["SAFETY_AREA_NO_AWARE"]


def test_the_order_of_events_does_not_matter(online: Runs) -> None:
    shuffled = online.events.filter(pl.col("kind") == "run_started").sample(fraction=1, shuffle=True, seed=1)
    assert plan_labels(shuffled).equals(plan_labels(online.events))
