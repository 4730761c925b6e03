"""Plans found: they solve their problem, are as good as the best of all, and say what is not known."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from sure_times import less_sure, sure_times

from hrclog.analyzers.search import search
from hrclog.analyzers.search.encoded import Encoded, encode_plans, encode_queues
from hrclog.analyzers.search.evaluate import evaluate
from hrclog.analyzers.search.find import Found, find_plan
from hrclog.analyzers.search.forecast import forecast
from hrclog.analyzers.search.judge import Judge, Objective, possible_plan
from hrclog.analyzers.search.local_search import Effort
from hrclog.analyzers.search.mean_durations import by_mean_durations
from hrclog.analyzers.search.reference import harmful_pairs
from hrclog.analyzers.search.search import MOST_ENUMERATED, WORLDS
from hrclog.analyzers.search.space import Candidate, space_of
from hrclog.analyzers.search.wish import Method, Wish
from hrclog.analyzers.search.worlds import drawn_worlds, expected_world
from hrclog.arrays import FloatArray
from hrclog.errors import ScenarioError
from hrclog.knowledge.task_times import NOTHING, AgentTask, Factor, Gap, TaskTime, TaskTimes, with_guesses
from hrclog.planning.plan import check_plan, make_plan
from hrclog.planning.problem import Count, Precedence, PrecedenceKind, Problem, Task
from hrclog.sim.scenario import load_scenario

pytestmark = pytest.mark.slow  # each test looks for plans

SCENARIOS = ("paper", "kitting", "three-agents", "machine-tending")
SMALL = ("paper", "kitting")

Pair = tuple[AgentTask, AgentTask]


QUICK = (Method.AUTO, Method.LOCAL, Method.BASELINE, Method.NOT_NEIGHBORING, Method.RANDOM)


@pytest.mark.parametrize(
    ("name", "method"),
    [*((name, method) for name in SCENARIOS for method in QUICK), *((name, Method.ENUMERATE) for name in SMALL)],
)
def test_every_method_finds_a_plan_that_solves_the_problem(name: str, method: Method) -> None:
    check_found(name, Wish(method=method, effort=Effort(plans=600)))


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENARIOS)
def test_constraint_programming_finds_a_plan_that_solves_the_problem(name: str) -> None:
    check_found(name, Wish(method=Method.CPSAT, effort=Effort(600, 2.0)))


def check_found(name: str, wish: Wish) -> None:
    """Raise if what is found is no plan of a scenario, or says of itself what is not so."""
    scenario = load_scenario(name)
    found = find_plan(scenario.problem, sure_times(scenario), wish, "mine")
    check_plan(scenario.problem, found.plan)
    assert found.plan.name == "mine"
    assert all(item.planned_start_s is not None for item in found.plan.items)
    assert found.forecast.undisturbed_s >= found.bound_s - 1e-6
    assert found.gap >= 0
    assert (found.guessed, found.unobserved) == ((), ())
    json.dumps(found.to_json(), allow_nan=False)


@pytest.mark.parametrize("name", SMALL)
@pytest.mark.parametrize("objective", list(Objective))
def test_the_best_of_all_plans_is_found_and_local_search_comes_close(name: str, objective: Objective) -> None:
    scenario = load_scenario(name)
    space, times = space_of(scenario.problem), less_sure(sure_times(scenario), 0.05)
    worlds = drawn_worlds(times, space.keys, space.agents, space.longest(), WORLDS, 1)
    judge = Judge(space, worlds, objective, times=times)
    scores = judge.scores(list(space.candidates()))
    for method, slack in ((Method.AUTO, 0.0), (Method.LOCAL, 0.005)):
        found = find_plan(scenario.problem, times, Wish(objective, method, seed=1, effort=Effort(4000)))
        [own] = judge.scores([space.candidate(found.plan.orders())])
        assert own <= scores.min() * (1 + slack) + 1e-9
        assert found.search.best[0].score == pytest.approx(own)
        assert found.search.exhaustive == (method is Method.AUTO)
    assert found.wish.method is Method.LOCAL


def test_auto_searches_where_there_are_too_many_plans() -> None:
    scenario = load_scenario("three-agents")
    assert space_of(scenario.problem).size(MOST_ENUMERATED) > MOST_ENUMERATED
    found = find_plan(scenario.problem, sure_times(scenario), Wish(effort=Effort(400)))
    assert (found.wish.method, found.search.exhaustive) == (Method.LOCAL, False)
    assert found.search.judged >= 400
    assert found.forecast.mean_s < 0.95 * found.usual_s


def test_the_best_plan_is_better_than_the_mean_of_all() -> None:
    scenario = load_scenario("paper")
    found = find_plan(scenario.problem, sure_times(scenario))
    assert found.forecast.mean_s < found.usual_s
    space = space_of(scenario.problem)
    plans = [possible_plan(space, candidate) for candidate in space.candidates()]
    encoded = encode_plans(scenario.problem, space.keys, [plan for plan in plans if plan])
    worlds = drawn_worlds(sure_times(scenario), space.keys, space.agents, space.longest(), 32, 1)
    assert found.usual_s == pytest.approx(evaluate(encoded, worlds).makespan_s.mean(), rel=0.01)


# references


def by_durations(name: str) -> tuple[list[Candidate], FloatArray, Encoded, TaskTimes]:
    """Return all plans of a scenario and their makespans by mean durations."""
    scenario = load_scenario(name)
    space, times = space_of(scenario.problem), sure_times(scenario)
    candidates = list(space.candidates())
    if space.linked:
        plans = [possible_plan(space, one) for one in candidates]
        encoded = encode_plans(scenario.problem, space.keys, [plan for plan in plans if plan])
        candidates = [one for one, plan in zip(candidates, plans, strict=True) if plan]
    else:
        encoded = encode_queues(space.agents, space.keys, [space.queues(one) for one in candidates])
    world = expected_world(by_mean_durations(times), space.keys, space.agents, space.longest(), synergies=False)
    return candidates, evaluate(encoded, world).makespan_s[:, 0], encoded, times


@pytest.mark.parametrize("name", SMALL)
def test_baseline_takes_one_of_the_plans_with_the_least_makespan_by_mean_durations(name: str) -> None:
    scenario = load_scenario(name)
    candidates, makespan, _, times = by_durations(name)
    best = {one for one, value in zip(candidates, makespan, strict=True) if value <= makespan.min() + 1e-6}
    space = space_of(scenario.problem)
    found = [find_plan(scenario.problem, times, Wish(method=Method.BASELINE, seed=seed)) for seed in range(6)]
    chosen = [space.candidate(one.plan.orders()) for one in found]
    assert set(chosen) <= best
    assert len(best) > 3
    assert len(set(chosen)) > 3
    assert all({ranked.candidate for ranked in one.search.best} == best for one in found)


def beside_s(encoded: Encoded, times: TaskTimes, pairs: Sequence[Pair]) -> FloatArray:
    """Return for how long each plan has pairs side by side, by mean durations; shape (B,)."""
    cost = np.zeros((len(encoded.keys) + 1,) * 2)
    for one, other in pairs:
        i, j = encoded.keys.index(one), encoded.keys.index(other)
        cost[i, j] = cost[j, i] = 1.0
    size = encoded.task.shape[-1]
    world = expected_world(by_mean_durations(times), encoded.keys, encoded.agents, size, synergies=False)
    return evaluate(encoded, world, cost=cost).cost[:, 0]


@pytest.mark.parametrize("name", SMALL)
def test_not_neighboring_keeps_pairs_apart_as_no_other_plan_does(name: str) -> None:
    scenario = load_scenario(name)
    problem, space = scenario.problem, space_of(scenario.problem)
    candidates, makespan, encoded, times = by_durations(name)
    pairs = [(i, j) for i in space.keys for j in space.keys if i[0] < j[0]]
    chosen = [pairs[place] for place in np.random.default_rng(1).permutation(len(pairs))[:8]]
    for avoid in ((chosen[0],), (chosen[1], chosen[2]), tuple(chosen[3:7])):
        found = find_plan(problem, times, Wish(method=Method.NOT_NEIGHBORING, avoid=avoid))
        overlap = beside_s(encoded, times, avoid)
        own = candidates.index(space.candidate(found.plan.orders()))
        assert overlap[own] <= overlap.min() + 1e-3
        assert makespan[own] <= makespan[overlap <= overlap.min() + 1e-9].min() + 1e-6


def test_pairs_that_hinder_each_other_beyond_chance_are_avoided_unless_others_are_named() -> None:
    scenario = load_scenario("paper")
    _, _, encoded, times = by_durations("paper")
    harmful = harmful_pairs(times)
    assert set(harmful) == {pair for pair, factor in scenario.factors.items() if factor > 1}
    unsure = replace(times, times=less_sure(times, 0.3).times)
    assert set(harmful_pairs(unsure)) == {
        pair for pair, factor in scenario.factors.items() if math.log(factor) > 1.645 * 0.3
    }
    space = space_of(scenario.problem)
    found = find_plan(scenario.problem, unsure, Wish(method=Method.NOT_NEIGHBORING))
    own = encode_queues(space.agents, space.keys, [found.plan.orders()])
    avoided = harmful_pairs(unsure)
    assert beside_s(own, times, avoided)[0] == pytest.approx(beside_s(encoded, times, avoided).min(), abs=1e-3)


def test_pairs_to_avoid_must_exist() -> None:
    scenario = load_scenario("paper")
    wish = Wish(method=Method.NOT_NEIGHBORING, avoid=((("human", "pick_white_box"), ("robot", "dance")),))
    with pytest.raises(ScenarioError, match="pairs to avoid: found 'dance' by 'robot', expected of "):
        find_plan(scenario.problem, sure_times(scenario), wish)


def test_random_plans_differ_from_seed_to_seed() -> None:
    scenario = load_scenario("paper")
    wishes = [Wish(method=Method.RANDOM, seed=seed) for seed in range(5)]
    found = [find_plan(scenario.problem, sure_times(scenario), wish).plan.orders() for wish in wishes]
    assert len({str(orders) for orders in found}) > 3


@pytest.mark.parametrize("method", [Method.AUTO, Method.LOCAL, Method.BASELINE, Method.RANDOM])
def test_the_same_seed_gives_the_same_answer(method: Method) -> None:
    scenario = load_scenario("kitting")
    times = less_sure(sure_times(scenario), 0.1)
    wish = Wish(method=method, seed=7, effort=Effort(500), explore=True)
    one, other = (find_plan(scenario.problem, times, wish).to_json() for _ in range(2))
    assert json.dumps(one) == json.dumps(other)


# a small cell: A and B each do a, b and c once

ITEMS = ("a", "b", "c")
SMALL_CELL = Problem(
    ("A", "B"),
    tuple(Task(f"{name}{agent}", (agent,)) for agent in "AB" for name in ITEMS),
    tuple(Count(f"{name}{agent}", 1) for agent in "AB" for name in ITEMS),
)


def small_times(sigma: float = 0.05, **sigmas: float) -> TaskTimes:
    times = {
        key: TaskTime(*key, math.log(5.0), sigmas.get(key[1], sigma), 50, covariance=np.zeros((2, 2)), observed_s=5.0)
        for key in SMALL_CELL.agent_tasks()
    }
    return TaskTimes(times, {agent: Gap(agent, 0.2, 0.0, 50) for agent in "AB"})


def with_factors(times: TaskTimes, factors: dict[Pair, float], deviation: float = 0.0) -> TaskTimes:
    found = dict(times.times)
    for (key, other), factor in factors.items():
        factors_of = (*found[key].factors, Factor(*other, math.log(factor), 9))
        spread = np.diag([0.0, 0.0, *[deviation**2] * len(factors_of)])
        found[key] = replace(found[key], factors=factors_of, covariance=spread)
    return replace(times, times=found)


A_B: Pair = (("A", "aA"), ("B", "aB"))


def all_pairs(factor: float) -> dict[Pair, float]:
    keys = SMALL_CELL.agent_tasks()
    return {(i, j): factor for i in keys for j in keys if i[0] != j[0]}


def test_a_pair_that_hinders_is_kept_apart_and_that_is_said() -> None:
    times = with_factors(small_times(), all_pairs(1.0) | {A_B: 4.0, (A_B[1], A_B[0]): 4.0})
    found = find_plan(SMALL_CELL, times)
    first = found.changes[0]
    assert ((first.agent, first.task), (first.other_agent, first.other_task)) == A_B
    assert first.overlap_s < first.usual_overlap_s
    assert first.saved_s > 0
    assert found.unobserved == ()


def test_pairs_of_which_nobody_saw_either_way_are_named() -> None:
    one_way = {pair: factor for pair, factor in all_pairs(1.0).items() if pair[0][0] == "A"}
    assert find_plan(SMALL_CELL, with_factors(small_times(), one_way)).unobserved == ()
    unseen = (("A", "aA"), ("B", "bB"))
    times = with_factors(small_times(), {pair: factor for pair, factor in one_way.items() if pair[1] == unseen[1]})
    for one, other in find_plan(SMALL_CELL, times).unobserved:
        assert other != unseen[1]
        assert one[0] == "A"
    assert find_plan(SMALL_CELL, small_times()).unobserved


def test_guessed_tasks_are_named() -> None:
    fewer = small_times()
    known = replace(fewer, times={key: time for key, time in fewer.times.items() if key[1] not in ("aA", "cB")})
    with pytest.raises(ScenarioError, match="aA by A, cB by B"):
        find_plan(SMALL_CELL, known)
    found = find_plan(SMALL_CELL, with_guesses(known, {("A", "aA"): 4.0, ("B", "cB"): 6.0, ("B", "bB"): 5.0}))
    assert found.guessed == (("A", "aA"), ("B", "cB"))
    assert find_plan(SMALL_CELL, with_guesses(NOTHING, dict.fromkeys(SMALL_CELL.agent_tasks(), 5.0))).guessed == tuple(
        SMALL_CELL.agent_tasks()
    )


def test_p95_minds_how_much_plans_vary() -> None:
    """B does b beside A's first task: beside `wild` it is shorter on average, but not for certain."""
    wild, sure, b, rest = ("A", "wild"), ("A", "sure"), ("B", "b"), ("B", "rest")
    chain = (Precedence("b", "rest"),)
    tasks = (Task("wild", ("A",)), Task("sure", ("A",)), Task("b", ("B",)), Task("rest", ("B",)))
    problem = Problem(("A", "B"), tasks, tuple(Count(task.name, 1) for task in tasks), chain)
    factors = (Factor(*sure, math.log(1.9), 9), Factor(*wild, math.log(1.5), 9))
    calm, beside = (Factor(*sure, 0.0, 9), Factor(*wild, 0.0, 9)), (Factor(*b, 0.0, 9), Factor(*rest, 0.0, 9))
    times = TaskTimes(
        {
            wild: TaskTime(*wild, math.log(5.0), 0.01, 9, beside, np.zeros((4, 4))),
            sure: TaskTime(*sure, math.log(5.0), 0.01, 9, beside, np.zeros((4, 4))),
            b: TaskTime(*b, math.log(2.0), 0.01, 9, factors, np.diag([0.0, 0.0, 0.0, 0.5**2])),
            rest: TaskTime(*rest, math.log(10.0), 0.01, 9, calm, np.zeros((4, 4))),
        },
        {},
    )
    space = space_of(problem)
    worlds = drawn_worlds(times, space.keys, space.agents, space.longest(), WORLDS, 0)
    queues = [space.queues(one) for one in space.candidates()]
    makespan = evaluate(encode_queues(space.agents, space.keys, queues), worlds).makespan_s
    for objective, values, first in (
        (Objective.MEAN, makespan.mean(axis=1), "wild"),
        (Objective.P95, np.quantile(makespan, 0.95, axis=1), "sure"),
    ):
        found = find_plan(problem, times, Wish(objective))
        assert found.search.best[0].score == pytest.approx(values.min())
        assert found.plan.queue("A")[0].task == first


@pytest.mark.parametrize("method", [Method.AUTO, Method.LOCAL])
def test_exploration_tries_pairs_of_which_little_is_known(method: Method, monkeypatch: pytest.MonkeyPatch) -> None:
    """By what is expected, aA beside aB is bad; it may be good, and exploration finds out now and then."""
    monkeypatch.setattr(search, "_KEPT", 1)  # so that local search itself has to explore
    factors = all_pairs(1.0) | {A_B: 1.3, (A_B[1], A_B[0]): 1.3}
    times = with_factors(small_times(0.01), factors)
    for key, other in (A_B, A_B[::-1]):
        time = times.times[key]
        assert time.covariance is not None
        covariance = time.covariance.copy()
        place = 2 + [(f.other_agent, f.other_task) for f in time.factors].index(other)
        covariance[place, place] = 1.0
        times = replace(times, times={**times.times, key: replace(time, covariance=covariance)})

    def side_by_side(seed: int, *, explore: bool) -> bool:
        wish = Wish(method=method, seed=seed, explore=explore, effort=Effort(300))
        found = find_plan(SMALL_CELL, times, wish)
        [beside] = [c.overlap_s for c in found.changes if {c.task, c.other_task} == {"aA", "aB"}]
        return beside > 1.0

    tried = [side_by_side(seed, explore=True) for seed in range(12)]
    assert 1 <= sum(tried) <= 8
    assert not any(side_by_side(seed, explore=False) for seed in range(3))


# what cannot be


def test_a_due_time_that_no_plan_keeps_is_told_with_the_task_and_by_how_much() -> None:
    tasks = tuple(replace(task, due_s=9.0) if task.name in ("aA", "bA") else task for task in SMALL_CELL.tasks)
    problem = replace(SMALL_CELL, tasks=tasks)
    times = with_factors(small_times(0.001), all_pairs(1.0))
    with pytest.raises(
        ScenarioError, match=r"task '[ab]A': due_s is 9, .* ends it at 10\.4 s, 1\.4 s late; allow more"
    ):
        find_plan(problem, times)
    later = replace(SMALL_CELL, tasks=tuple(replace(t, due_s=10.5) if t.due_s else t for t in tasks))
    found = find_plan(later, times)
    assert {item.task for item in found.plan.queue("A")[:2]} == {"aA", "bA"}


def test_nothing_starts_before_its_release() -> None:
    tasks = tuple(replace(task, release_s=8.0) if task.name == "aA" else task for task in SMALL_CELL.tasks)
    found = find_plan(replace(SMALL_CELL, tasks=tasks), small_times(0.001))
    [released] = [item for item in found.plan.items if item.task == "aA"]
    assert (released.planned_start_s or 0.0) >= 8.0
    assert found.plan.queue("A")[0].task != "aA"


def test_a_resource_is_held_by_one_at_a_time() -> None:
    tasks = tuple(replace(task, resources=("jig",)) if task.name[0] in "ab" else task for task in SMALL_CELL.tasks)
    found = find_plan(replace(SMALL_CELL, tasks=tasks), with_factors(small_times(0.001), all_pairs(1.0)))
    spans = sorted((i.planned_start_s or 0.0, i.planned_end_s or 0.0) for i in found.plan.items if i.task[0] in "ab")
    assert len(spans) == 4
    assert all(begin >= end - 1e-9 for (_, end), (begin, _) in pairwise(spans))


def test_precedences_that_cannot_be_kept_are_named() -> None:
    problem = _crossed()
    times = TaskTimes({key: TaskTime(*key, 1.0, 0.1, 9) for key in problem.agent_tasks()}, {})
    for method in (Method.AUTO, Method.LOCAL, Method.BASELINE):
        with pytest.raises(ScenarioError, match=r"no plan is possible: .*x -> y \(next\)"):
            find_plan(problem, times, Wish(method=method, effort=Effort(200)))
    with pytest.raises(ScenarioError, match="x -> y"):
        find_plan(problem, times, Wish(method=Method.RANDOM))


def _crossed() -> Problem:
    """Return a problem whose chains x -> y and u -> v each wait for the other's inside."""
    return Problem(
        ("A", "B"),
        (Task("x", ("A",)), Task("y", ("A",)), Task("u", ("B",)), Task("v", ("B",))),
        (Count("x", 2), Count("y", 2), Count("u", 1), Count("v", 1)),
        (
            Precedence("x", "y", PrecedenceKind.NEXT),
            Precedence("u", "v", PrecedenceKind.NEXT),
            Precedence("x", "v", PrecedenceKind.ALL),
            Precedence("u", "y", PrecedenceKind.ALL),
            Precedence("v", "y", PrecedenceKind.ALL),
        ),
    )


def test_a_plan_is_not_told_of_by_the_worlds_that_it_was_chosen_in() -> None:
    times = with_factors(small_times(0.3), all_pairs(1.0))
    found = find_plan(SMALL_CELL, times, Wish(seed=3))
    bare = make_plan(SMALL_CELL, found.plan.orders())
    assert found.forecast.mean_s != forecast(SMALL_CELL, bare, times, worlds=WORLDS, seed=3).mean_s
    assert found.forecast.mean_s == forecast(SMALL_CELL, bare, times, seed=4).mean_s


def test_what_is_found_is_told_as_json_values() -> None:
    found: Found = find_plan(SMALL_CELL, small_times(), Wish(seed=3))
    told = json.loads(json.dumps(found.to_json(), allow_nan=False))
    assert (told["method"], told["objective"], told["judged"], told["exhaustive"]) == ("enumerate", "mean", 36, True)
    assert told["plan"] == found.plan.to_json()
    assert told["forecast"]["items"].keys() == {item.item_id for item in found.plan.items}
    assert told["unobserved"][0] == [*found.unobserved[0][0], *found.unobserved[0][1]]
