"""Plans drawn at random: valid, different, and the same for the same seed."""

from __future__ import annotations

import itertools
import random
from collections import Counter
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hrclog.errors import ScenarioError
from hrclog.planning.plan import check_plan
from hrclog.planning.problem import Count, Precedence, PrecedenceKind, Problem, Task
from hrclog.planning.random_plans import distinct_plans, random_orders, random_plans


def paper(*, free: bool) -> Problem:
    """Return the paper's problem, the blue boxes dealt out (225 plans) or free (715)."""
    domains = {"blue": ("H", "R"), "orange": ("R",), "white": ("H",)}
    tasks = [Task(f"{verb}_{colour}", domain) for colour, domain in domains.items() for verb in ("pick", "place")]
    shares = [("white", "H", 4), ("orange", "R", 4)]
    shares += [("blue", "", 4)] if free else [("blue", "H", 2), ("blue", "R", 2)]
    counts = [Count(f"{verb}_{colour}", n, agent) for colour, agent, n in shares for verb in ("pick", "place")]
    rules = [Precedence(f"pick_{colour}", f"place_{colour}") for colour in domains]
    return Problem(("H", "R"), tuple(tasks), tuple(counts), tuple(rules))


@st.composite
def problems(draw: st.DrawFn) -> Problem:
    """Draw problems of 1-3 agents and 1-5 tasks in a row of precedences, all of them solvable."""
    agents = tuple("ABC"[: draw(st.integers(1, 3))])
    n_tasks = draw(st.integers(1, 5))
    number = draw(st.integers(1, 3))
    kinds = [draw(st.sampled_from([None, *PrecedenceKind])) for _ in range(n_tasks - 1)]
    tasks, counts, rules = [], [], []
    domain = agents
    for place in range(n_tasks):
        kind = kinds[place - 1] if place else None
        if kind is not PrecedenceKind.NEXT:  # what must follow keeps domain and count
            domain = tuple(sorted(draw(st.sets(st.sampled_from(agents), min_size=1))))
            number = draw(st.integers(1, number if kind is PrecedenceKind.EACH else 3))
        tasks.append(Task(f"t{place}", domain))
        counts.append(Count(f"t{place}", number))
        if kind is not None:
            rules.append(Precedence(f"t{place - 1}", f"t{place}", kind))
    return Problem(agents, tuple(tasks), tuple(counts), tuple(rules))


@pytest.mark.slow
@given(problems(), st.integers())
def test_every_plan_drawn_is_valid_and_different(problem: Problem, seed: int) -> None:
    plans = list(itertools.islice(random_plans(problem, seed), 5))
    assert plans
    for plan in plans:
        check_plan(problem, plan)
    keys = [tuple(plan.orders().items()) for plan in plans]
    assert len(set(keys)) == len(keys)


@pytest.mark.slow
@pytest.mark.parametrize(("free", "count"), [(False, 225), (True, 715)])
def test_the_paper_has_225_plans_and_715_with_free_blue_boxes(free: bool, count: int) -> None:
    assert len(distinct_plans(paper(free=free), count, 1)) == count
    with pytest.raises(ScenarioError, match=f"{count + 1} different plans were asked for, the problem has {count}"):
        distinct_plans(paper(free=free), count + 1, 1)


def test_the_same_seed_draws_the_same_plans_and_another_seed_others() -> None:
    problem = paper(free=False)
    assert distinct_plans(problem, 20, 1) == distinct_plans(problem, 20, 1)
    assert distinct_plans(problem, 20, 1) != distinct_plans(problem, 20, 2)


def test_the_first_plans_do_not_depend_on_how_many_are_drawn() -> None:
    problem = paper(free=True)
    assert distinct_plans(problem, 50, 3)[:10] == distinct_plans(problem, 10, 3)


def test_an_agents_orders_are_equally_likely() -> None:
    problem = Problem(("H",), (Task("a", ("H",)), Task("b", ("H",))), (Count("a", 2), Count("b", 1)))
    source = random.Random(1)
    shares = Counter(random_orders(problem, source)["H"] for _ in range(3000))
    assert set(shares) == set(itertools.permutations("aab"))
    assert all(abs(count / 3000 - 1 / 3) < 0.04 for count in shares.values())


def test_a_problem_that_always_comes_to_a_standstill_is_named() -> None:
    tasks = tuple(Task(name, ("H",)) for name in "abc")
    rules = (Precedence("a", "b"), Precedence("a", "c", PrecedenceKind.EACH), Precedence("c", "b", PrecedenceKind.EACH))
    problem = Problem(("H",), tasks, tuple(Count(name, 1) for name in "abc"), rules)
    with pytest.raises(ScenarioError, match="1000 random orders all came to a standstill"):
        next(random_plans(problem, 1))


def test_the_precedences_that_cannot_be_kept_together_are_named_and_no_others() -> None:
    tasks = tuple(Task(name, ("H",)) for name in "abcd")
    conflict = (Precedence("a", "b"), Precedence("c", "b", PrecedenceKind.EACH))
    rules = (Precedence("a", "d", PrecedenceKind.ALL), *conflict, Precedence("a", "c", PrecedenceKind.ALL))
    problem = Problem(("H",), tasks, tuple(Count(name, 1) for name in "abcd"), rules)
    named = r"together a -> b \(next\), c -> b \(each\), a -> c \(all\) cannot be kept, loosen one of them"
    with pytest.raises(ScenarioError, match=named):
        next(random_plans(problem, 1))


def test_plans_drawn_for_tasks_that_are_released_later_wait_for_it() -> None:
    problem = paper(free=True)
    late = replace(problem, tasks=tuple(replace(task, release_s=4.0) for task in problem.tasks))
    for plan in distinct_plans(late, 5, 1):
        check_plan(late, plan)
        assert all(item.needs for item in plan.items)
