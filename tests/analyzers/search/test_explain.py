"""What a plan does better than others: overlaps, pair by pair."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from planning import true_times

from hrclog.analyzers.search.encoded import encode_queues
from hrclog.analyzers.search.evaluate import evaluate
from hrclog.analyzers.search.explain import overlaps_s, pair_changes
from hrclog.analyzers.search.judge import Judge
from hrclog.analyzers.search.space import space_of
from hrclog.analyzers.search.worlds import Worlds, drawn_worlds, expected_world
from hrclog.sim.scenario import load_scenario

_KEYS = [("A", "a"), ("A", "b"), ("B", "c"), ("B", "d"), ("C", "e")]
_ROWS = st.tuples(*(st.lists(st.sampled_from(tasks), max_size=3) for tasks in ("ab", "cd", "e")))


def _worlds(seed: int) -> Worlds:
    source = np.random.default_rng(seed)
    rate = source.uniform(0.3, 1.5, (2, 6, 6))
    rate[:, -1] = rate[:, :, -1] = 1.0
    return Worlds(source.uniform(0.5, 5.0, (2, 5, 4)), rate, source.uniform(0.0, 0.5, (2, 3, 4)))


@settings(max_examples=30, deadline=None)
@given(st.lists(_ROWS, min_size=1, max_size=3), st.integers(0, 99))
def test_overlaps_are_those_of_every_two_executions(rows: list[tuple[list[str], ...]], seed: int) -> None:
    plans = encode_queues("ABC", _KEYS, [dict(zip("ABC", row, strict=True)) for row in rows])
    found = evaluate(plans, _worlds(seed), timeline=True)
    assert found.start_s is not None
    assert found.end_s is not None
    expected = np.zeros((5, 5))
    for index, row in enumerate(rows):
        for world in range(2):
            spans = [
                (a, _KEYS.index(("ABC"[a], task)), found.start_s[index, world, a, n], found.end_s[index, world, a, n])
                for a, tasks in enumerate(row)
                for n, task in enumerate(tasks)
            ]
            for a, i, begin, end in spans:
                for b, j, other_begin, other_end in spans:
                    if a != b:
                        beside = max(0.0, min(end, other_end) - max(begin, other_begin))
                        expected[i, j] += beside / (2 * len(rows))
    overlaps = overlaps_s(plans, found)
    assert overlaps == pytest.approx(expected, abs=1e-9)
    assert (overlaps == overlaps.T).all()


def test_pairs_say_what_they_save_in_agents_time() -> None:
    """Plan: x beside y only half as long as usual, at rate 1/2 for x: half of what it spares is saved."""
    keys = [("A", "w"), ("A", "x"), ("B", "y"), ("B", "z")]
    rate = np.ones((1, 5, 5))
    rate[0, 1, 2] = 0.5
    worlds = Worlds(np.full((1, 4, 2), 4.0), rate, np.zeros((1, 2, 3)))
    apart = encode_queues("AB", keys, [{"A": ["w", "x"], "B": ["y", "z"]}])
    usual = encode_queues("AB", keys, [{"A": ["x", "w"], "B": ["y", "z"]}])
    change, *rest = pair_changes(apart, usual, worlds)
    assert (change.agent, change.task, change.other_agent, change.other_task) == ("A", "x", "B", "y")
    assert (change.overlap_s, change.usual_overlap_s, change.saved_s) == (0.0, 4.0, 2.0)
    assert [one.saved_s for one in rest] == [0.0] * 3
    worse = pair_changes(usual, apart, worlds)[-1]
    assert worse.saved_s == -2.0
    assert change.to_json()["saved_s"] == 2.0


def test_pairs_are_sorted_by_what_they_save_and_only_those_of_two_agents() -> None:
    scenario = load_scenario("paper")
    space, times = space_of(scenario.problem), true_times(scenario)
    world = expected_world(times, space.keys, space.agents, space.longest())
    candidates = list(space.candidates())
    best = candidates[int(Judge(space, world).scores(candidates).argmin())]
    plan, usual = (
        encode_queues(space.agents, space.keys, [space.queues(one) for one in some]) for some in ([best], candidates)
    )
    changes = pair_changes(plan, usual, drawn_worlds(times, space.keys, space.agents, space.longest(), 4))
    assert [change.saved_s for change in changes] == sorted((c.saved_s for c in changes), reverse=True)
    assert changes
    assert all(change.agent != change.other_agent for change in changes)
    assert sum(change.saved_s for change in pair_changes(plan, usual, world)) > 0.0


def test_in_the_mean_over_all_plans_nothing_is_saved() -> None:
    scenario = load_scenario("paper")
    space, times = space_of(scenario.problem), true_times(scenario)
    world = expected_world(times, space.keys, space.agents, space.longest())
    plans = encode_queues(space.agents, space.keys, [space.queues(one) for one in space.candidates()])
    assert all(change.saved_s == 0.0 for change in pair_changes(plans, plans, world))
