"""All plans of a problem: each once, none left out."""

from __future__ import annotations

from collections import Counter
from itertools import permutations, product

from hypothesis import given, settings
from hypothesis import strategies as st
from planning_problems import problems

from hrclog.analyzers.search.judge import possible_plan
from hrclog.analyzers.search.space import Space, space_of
from hrclog.planning.problem import Count, Precedence, Problem, Task
from hrclog.planning.random_plans import random_plans

_SMALL = problems().map(space_of).filter(lambda space: space.size(400) <= 400)


@settings(max_examples=40, deadline=None)
@given(_SMALL)
def test_the_plans_of_a_space_are_all_different_and_as_many_as_its_size(space: Space) -> None:
    candidates = list(space.candidates())
    assert len(set(candidates)) == len(candidates) == space.size(10_000)


@settings(max_examples=40, deadline=None)
@given(_SMALL)
def test_every_plan_does_every_unit_as_often_as_asked_by_agents_that_can(space: Space) -> None:
    for candidate in space.candidates():
        assert Counter(unit for row in candidate for unit in row) == Counter(dict(enumerate(space.counts)))
        assert all(a in space.units[u].agents for a, row in zip(space.agents, candidate, strict=True) for u in row)


@settings(max_examples=20, deadline=None)
@given(problems((1, 2), rules=False).map(space_of).filter(lambda space: sum(space.counts) <= 6))
def test_the_plans_are_those_that_brute_force_over_copies_finds(space: Space) -> None:
    copies = [unit for unit, count in enumerate(space.counts) for _ in range(count)]
    found = set()
    for dealt in product(*(space.units[unit].agents for unit in copies)):
        rows = [[u for u, a in zip(copies, dealt, strict=True) if a == agent] for agent in space.agents]
        found |= set(product(*(set(permutations(row)) for row in rows)))
    assert found == set(space.candidates())


@settings(max_examples=10, deadline=None)
@given(problems((2,)).map(space_of).filter(lambda space: space.size(60) <= 60), st.integers(0, 9))
def test_plans_drawn_at_random_are_among_the_candidates(space: Space, seed: int) -> None:
    plans = [possible_plan(space, candidate) for candidate in space.candidates()]
    known = [plan.orders() for plan in plans if plan is not None]
    for plan, _ in zip(random_plans(space.problem, seed), range(5), strict=False):
        assert plan.orders() in known


def test_a_space_that_is_too_large_to_count_is_more_than_asked_for() -> None:
    tasks = tuple(Task(f"t{n}", ("A", "B")) for n in range(6))
    space = space_of(Problem(("A", "B"), tasks, tuple(Count(task.name, 30) for task in tasks)))
    assert space.size(1000) > 1000


def test_what_must_follow_at_once_is_one_unit() -> None:
    tasks = (Task("pick", ("A", "B")), Task("place", ("B",)), Task("look", ("A",)))
    counts = (Count("pick", 2), Count("place", 2), Count("look", 1))
    space = space_of(Problem(("A", "B"), tasks, counts, (Precedence("pick", "place"),)))
    assert [(unit.tasks, unit.agents) for unit in space.units] == [(("pick", "place"), ("B",)), (("look",), ("A",))]
    assert list(space.candidates()) == [((1,), (0, 0))]
    assert space.queues(((1,), (0, 0))) == {"A": ("look",), "B": ("pick", "place", "pick", "place")}
    assert (space.keys, space.longest()) == ([("A", "look"), ("B", "pick"), ("B", "place")], 4)


def test_an_agents_own_work_is_told_from_work_for_anybody_that_begins_with_the_same_task() -> None:
    tasks = (Task("pick", ("A", "B")), Task("sweep", ("A",)))
    counts = (Count("pick", 1, "A"), Count("pick", 2), Count("sweep", 1, "A"))
    space = space_of(Problem(("A", "B"), tasks, counts))
    for candidate in space.candidates():
        again = space.candidate(space.queues(candidate))
        assert sorted(unit for row in again for unit in row) == sorted(unit for row in candidate for unit in row)
        assert space.queues(again) == space.queues(candidate)
