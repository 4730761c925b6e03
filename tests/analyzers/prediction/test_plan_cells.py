"""Plan cells: the same place of the same plan."""

from __future__ import annotations

import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from interval_frames import Row, frame, row, rows

from hrclog.analyzers.prediction.plan_cells import plan_cells
from hrclog.analyzers.projections.intervals import is_counted


def plan(run: str, *tasks: tuple[str, str], shift: int = 0) -> list[Row]:
    """Return (agent, task) one after the other, 10 ns each."""
    return [
        row(agent, task, shift + n * 10, shift + n * 10 + 9, run_id=run, execution_id=f"{run}{n}")
        for n, (agent, task) in enumerate(tasks)
    ]


def cells(found: list[Row]) -> dict[str, str]:
    return dict(plan_cells(frame(found)).select("execution_id", "cell").iter_rows())


def positions(found: list[Row]) -> dict[str, int]:
    return dict(plan_cells(frame(found)).select("execution_id", "position").iter_rows())


TASKS = (("H", "a"), ("R", "b"), ("H", "a"), ("R", "c"), ("H", "d"))


def test_the_same_plan_at_another_time_and_pace_has_the_same_cells() -> None:
    other = [
        one | {"end_ns": one["end_ns"] - 3, "until_ns": one["end_ns"] - 3} for one in plan("t", *TASKS, shift=10**18)
    ]
    found = cells([*plan("s", *TASKS), *other])
    assert [found[f"s{n}"] for n in range(5)] == [found[f"t{n}"] for n in range(5)]
    assert len(set(found.values())) == 5


def test_only_the_order_of_each_agents_tasks_makes_a_plan() -> None:
    swapped = (TASKS[1], TASKS[0], *TASKS[2:])  # another interleaving
    found = cells([*plan("s", *TASKS), *plan("t", *swapped)])
    assert {found[f"s{n}"] for n in range(5)} == {found[f"t{n}"] for n in range(5)}
    for different in ((*TASKS[:4], ("H", "e")), TASKS[:4], (*TASKS, ("R", "b")), (("H", "d"), *TASKS[:4])):
        found = cells([*plan("s", *TASKS), *plan("t", *different)])
        assert not {found[f"s{n}"] for n in range(5)} & {cell for name, cell in found.items() if name[0] == "t"}


def test_attempts_at_one_item_are_one_position() -> None:
    tries = [
        row("H", "a", 0, 5, item_id="i", execution_id="e0", outcome="failed"),
        row("H", "a", 6, 9, item_id="i", execution_id="e1", attempt=2),
        row("H", "b", 10, 12, item_id="j", execution_id="e2"),
        row("R", "r", 0, 3, item_id="i", execution_id="e3"),  # another agent's work on the same item
    ]
    once = [one | {"run_id": "t", "execution_id": f"t{one['execution_id']}"} for one in tries[1:]]
    found = cells([*tries, *once])
    assert found["e0"] == found["e1"] == found["te1"]
    assert found["e2"] == found["te2"]
    assert positions(tries) == {"e0": 0, "e1": 0, "e2": 1, "e3": 0}


@pytest.mark.parametrize("name", ["i", "xi", "ii"])
def test_executions_without_an_item_are_items_of_their_own(name: str) -> None:
    found = [row("H", "a", 0, 5, execution_id="i"), row("H", "a", 6, 7, item_id=name, execution_id="x")]
    assert positions(found) == {"i": 0, "x": 1}


def test_names_that_read_alike_when_put_together_are_told_apart() -> None:
    pairs = [
        ("a", "bc"),
        ("ab", "c"),
        ("a|b", "c"),
        ("a", "b|c"),
        ("a1:b", "c"),
        ("1:a", "b"),
        ("é", "x"),
        ("e\u0301", "x"),
    ]
    found = cells([one for n, pair in enumerate(pairs) for one in plan(f"run{n}-", pair)])
    assert len(set(found.values())) == len(pairs)


def test_an_agent_named_like_the_beginning_of_a_plan_is_told_apart() -> None:
    strange = "a|1:a1:t"
    found = cells([*plan("s", ("a", "t"), (strange, "u")), *plan("t", (strange, "u"))])
    assert len(set(found.values())) == 3


def test_going_home_and_steps_of_sequences_are_no_part_of_a_plan() -> None:
    more = [
        row("H", "home", 100, 110, role="auxiliary", execution_id="home"),
        row("H", "step", 1, 2, parent_execution_id="s0", execution_id="step"),
    ]
    assert cells([*plan("run", *TASKS), *more]) == cells(plan("run", *TASKS))


@settings(max_examples=40)
@given(rows(max_size=12, runs="rst"), st.integers(0, 100))
def test_the_order_of_rows_is_irrelevant_and_nothing_is_lost(found: list[Row], seed: int) -> None:
    expected = plan_cells(frame(found)).sort("run_id", "execution_id")
    mixed = frame(found).sample(fraction=1.0, shuffle=True, seed=seed)
    assert plan_cells(mixed).sort("run_id", "execution_id").equals(expected)
    assert expected.height == frame(found).filter(is_counted()).height
    assert expected.select(pl.all().is_not_null().all()).row(0) == (True,) * 4


@settings(max_examples=40)
@given(rows(max_size=12, plain=True))
def test_positions_of_an_agent_count_from_zero(found: list[Row]) -> None:
    joined = plan_cells(frame(found)).join(frame(found), on=["run_id", "execution_id"])
    for _, part in joined.group_by("run_id", "agent"):
        assert sorted(part["position"]) == list(range(part.height))
