"""What tasks do to each other, counted tick by tick."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hrclog.sim.bullet.couplings import Couplings, Going
from hrclog.sim.bullet.stepped import TICK_S
from hrclog.sim.truth import PairTruth

ONE, OTHER = ("a", "t"), ("b", "u")


def test_an_agent_alone_overlaps_nobody() -> None:
    couplings = Couplings()
    couplings.count({})
    couplings.count({"a": Going(ONE, 0.5, 0.5)})
    assert couplings.pairs() == ()


def test_both_orders_of_a_pair_are_counted_with_their_own_progress() -> None:
    couplings = Couplings()
    for _ in range(100):
        couplings.count({"b": Going(OTHER, 1.0, 1.0), "a": Going(ONE, 0.25, 0.5)})
    assert couplings.pairs() == (
        PairTruth(*ONE, *OTHER, 1.0, 0.25, 0.5),
        PairTruth(*OTHER, *ONE, 1.0, 1.0, 1.0),
    )


def test_tasks_of_three_agents_are_counted_pair_by_pair() -> None:
    couplings = Couplings()
    couplings.count({name: Going((name, "t"), 1.0, 1.0) for name in "cab"})
    assert [(pair.agent, pair.other_agent) for pair in couplings.pairs()] == [
        *(("a", "b"), ("a", "c"), ("b", "a"), ("b", "c"), ("c", "a"), ("c", "b")),
    ]
    assert all(pair.overlap_s == TICK_S for pair in couplings.pairs())


shares = st.floats(0.0, 1.0)
ticks = st.dictionaries(st.sampled_from("abc"), st.tuples(st.sampled_from("tu"), shares, shares), max_size=3)


@given(st.lists(ticks, max_size=40))
def test_overlap_is_symmetric_and_no_progress_is_longer(said: list[dict[str, tuple[str, float, float]]]) -> None:
    couplings = Couplings()
    for tick in said:
        couplings.count({agent: Going((agent, task), own, asked) for agent, (task, own, asked) in tick.items()})
    found = {((p.agent, p.task), (p.other_agent, p.other_task)): p for p in couplings.pairs()}
    assert list(found) == sorted(found)
    for (one, other), pair in found.items():
        together = [
            tick for tick in said if tick.get(one[0], ("",))[0] == one[1] and tick.get(other[0], ("",))[0] == other[1]
        ]
        assert pair.overlap_s == pytest.approx(len(together) * TICK_S)
        assert pair.overlap_s == found[other, one].overlap_s
        assert 0.0 <= pair.progress_s <= pair.overlap_s + 1e-9
        assert pair.progress_s == pytest.approx(TICK_S * sum(tick[one[0]][1] for tick in together), abs=1e-8)
        assert pair.caused_progress_s == pytest.approx(TICK_S * sum(tick[one[0]][2] for tick in together), abs=1e-8)
