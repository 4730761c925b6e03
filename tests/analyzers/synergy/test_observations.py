"""Observations of runs: what they hold, and that runs can be put together, withdrawn and drawn."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import polars as pl
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from interval_frames import Row, frame, random_runs, row, rows
from polars.testing import assert_frame_equal

from hrclog.analyzers.projections.joint_states import State
from hrclog.analyzers.synergy.observations import EXECUTIONS, Observations, merge, observe
from hrclog.errors import HrclogError

SECOND = 1_000_000_000

Told = list[tuple[object, ...]]


def told(observations: Observations) -> Told:
    """Return what the executions say, states by what they stand for."""
    states = observations.states
    found: Told = []
    for one in observations.executions.to_dicts():
        spent = {states[number]: time for number, time in zip(one["state"] or [], one["seconds"] or [], strict=True)}
        last = None if one["last_state"] is None else states[one["last_state"]]
        known = tuple(one[name] for name in EXECUTIONS.names() if name not in ("state", "seconds", "last_state"))
        found.append((*known, spent, last))
    return found


def same(first: Observations, second: Observations) -> None:
    """Assert that two observations are equal to the last bit."""
    assert first.states == second.states
    assert_frame_equal(first.executions, second.executions, check_exact=True)
    assert_frame_equal(first.meetings, second.meetings, check_exact=True)


def parts_of(found: Sequence[Row]) -> dict[str, list[Row]]:
    parts: dict[str, list[Row]] = {}
    for one in found:
        parts.setdefault(one["run_id"], []).append(one)
    return parts


FOUND = random_runs(3, n_runs=9, agents="HRS", overlap_itself="S")
RUNS = sorted({one["run_id"] for one in FOUND})


@settings(max_examples=25)
@given(st.permutations(RUNS), st.lists(st.integers(1, 8), max_size=4))
def test_parts_in_any_order_make_the_whole(order: list[str], cuts: list[int]) -> None:
    edges = [0, *sorted(set(cuts)), len(order)]
    groups = [order[low:high] for low, high in pairwise(edges)]
    parts = [observe(frame([one for one in FOUND if one["run_id"] in group])) for group in groups]
    same(merge(parts), observe(frame(FOUND)))


@pytest.mark.slow
@settings(max_examples=40)
@given(rows(max_size=14, runs="rstu"))
def test_any_runs_put_together_are_the_runs(found: list[Row]) -> None:
    assume(found)
    parts = [observe(frame(part)) for part in parts_of(found).values()]
    same(merge(parts[::-1]), observe(frame(found)))
    same(merge([merge(parts[:1]), *parts[1:]]), observe(frame(found)))


@pytest.mark.slow
@settings(max_examples=40)
@given(rows(max_size=14, runs="rstu"), st.sets(st.sampled_from("rstu")))
def test_withdrawn_runs_leave_the_rest(found: list[Row], gone: set[str]) -> None:
    rest = observe(frame([one for one in found if one["run_id"] not in gone]))
    for left in (observe(frame(found)).without(gone), observe(frame(found)).only(set("rstu") - gone)):
        assert told(left) == told(rest)
        assert_frame_equal(left.meetings, rest.meetings, check_exact=True)
        assert left.runs == rest.runs
    same(merge([observe(frame(found)).without(gone)]), observe(frame(found)).without(gone))


def test_withdrawing_and_adding_again_changes_nothing() -> None:
    whole = observe(frame(FOUND))
    same(merge([whole.only(RUNS[2:4]), whole.without(RUNS[2:4])]), whole)


def test_a_run_that_is_drawn_twice_is_two_runs() -> None:
    whole = observe(frame(FOUND))
    draws = [RUNS[4], RUNS[1], RUNS[4]]
    drawn = whole.drawn(draws)
    assert len(drawn.runs) == 3
    renamed = {"run_id": pl.lit("")}
    for name, source in zip(drawn.runs, draws, strict=True):
        one, other = drawn.only([name]), whole.only([source])
        assert name.endswith(source)
        assert told(Observations(one.executions.with_columns(**renamed), one.states, one.meetings)) == told(
            Observations(other.executions.with_columns(**renamed), other.states, other.meetings)
        )
        assert_frame_equal(
            one.meetings.with_columns(**renamed), other.meetings.with_columns(**renamed), check_exact=True
        )
        assert other.meetings.height > 0


def test_drawing_every_run_once_is_the_whole_under_other_names() -> None:
    whole = observe(frame(FOUND))
    drawn = whole.drawn(RUNS)
    assert_frame_equal(drawn.executions.drop("run_id"), whole.executions.drop("run_id"), check_exact=True)
    assert_frame_equal(drawn.meetings.drop("run_id"), whole.meetings.drop("run_id"), check_exact=True)
    assert whole.drawn([]).runs == []


def test_the_same_run_in_two_parts_is_an_error_that_names_it() -> None:
    part = observe(frame(FOUND)).only(RUNS[:3])
    with pytest.raises(HrclogError, match=rf"run '{RUNS[2]}' is in two parts, expected each run once; withdraw"):
        merge([part, observe(frame(FOUND)).only(RUNS[2:5])])


def test_nothing_to_put_together_is_an_error() -> None:
    with pytest.raises(HrclogError, match="expected at least one part"):
        merge([])


@settings(max_examples=60)
@given(rows(max_size=12, scale=SECOND))
def test_time_is_neither_lost_nor_found(found: list[Row]) -> None:
    observations = observe(frame(found))
    assert observations.executions.schema == EXECUTIONS
    counting = {
        one["execution_id"]: one
        for one in found
        if one["role"] != "auxiliary" and not one["parent_execution_id"]
    }  # fmt: skip
    assert set(observations.executions["execution_id"]) == set(counting)
    for one in observations.executions.to_dicts():
        source = counting[one["execution_id"]]
        assert one["duration_s"] == (source["until_ns"] - source["start_ns"]) / 1e9
        assert one["finished"] == (source["outcome"] == "succeeded" and source["end_ns"] is not None)
        assert math.fsum(one["seconds"] or []) == pytest.approx(one["duration_s"], abs=1e-9)
        assert (one["last_state"] is None) == (one["duration_s"] == 0) == (one["state"] is None)
        assert one["duration_s"] == 0 or one["last_state"] in one["state"]


def test_the_last_state_is_what_runs_just_before_the_end() -> None:
    found = [row("H", "h", 0, 10), row("R", "r", 3, 10), row("R", "s", 10, 20), row("S", "s", 4, 9)]
    observations = observe(frame(found))
    states: list[State] = [(), (("R", "r"),), (("R", "r"), ("S", "s"))]
    first = told(observations)[0]
    assert first[-2] == {states[0]: 3e-9, states[1]: 2e-9, states[2]: 5e-9}
    assert first[-1] == states[1]


def test_the_order_of_the_rows_does_not_matter() -> None:
    whole = observe(frame(FOUND))
    for seed in range(3):
        same(observe(frame(FOUND).sample(fraction=1.0, shuffle=True, seed=seed)), whole)


def test_where_time_begins_does_not_matter() -> None:
    later = [pl.col(name) + 1_700_000_000_123_456_789 for name in ("start_ns", "end_ns", "until_ns")]
    same(observe(frame(FOUND).with_columns(later)), observe(frame(FOUND)))


def test_plans_without_numbers_do_not_matter() -> None:
    odd = [pl.lit(math.nan).alias("planned_duration_s"), pl.lit(math.inf).alias("planning_time_s")]
    same(observe(frame(FOUND).with_columns(odd)), observe(frame(FOUND)))


def test_pairs_are_the_successful_executions_with_whatever_overlaps_them() -> None:
    found = [
        row("H", "h", 0, 10 * SECOND),
        row("R", "r", 4 * SECOND, 8 * SECOND),
        row("R", "r", 8 * SECOND, 9 * SECOND, outcome="failed"),
        row("H", "i", 2 * SECOND, 6 * SECOND),  # of the same agent as x0
        row("S", "home", 0, 9 * SECOND, role="auxiliary"),
    ]
    observations = observe(frame(found))
    pairs = observations.pairs.select("execution_id", "other_execution_id", "overlap_s", "other_finished").rows()
    assert pairs == [
        ("x0", "x1", 4.0, True),
        ("x0", "x2", 1.0, False),
        ("x1", "x0", 4.0, True),
        ("x1", "x3", 2.0, True),
        ("x3", "x1", 2.0, True),
    ]
    more = observations.meetings.filter(~pl.col("finished"))
    assert more.select("execution_id", "other_execution_id", "overlap_s").rows() == [("x2", "x0", 1.0)]


def test_nothing_observed_is_an_empty_table() -> None:
    nothing = observe(frame([]))
    assert (nothing.executions.schema, nothing.executions.height, nothing.states) == (EXECUTIONS, 0, ())
    whole = observe(frame(FOUND))
    same(merge([nothing, whole]), whole)
    same(whole.only([]).drawn([]), Observations(nothing.executions, whole.states, nothing.meetings))


@pytest.mark.parametrize("seed", range(3))
def test_the_seconds_add_up_exactly_however_the_states_are_met(seed: int) -> None:
    # the same state in many pieces: their sum must not depend on how they are ordered in time
    source = np.random.default_rng(seed)
    lengths = source.integers(1, 10**10, (300, 2))

    def spent(pieces: np.ndarray) -> dict[State, float]:
        edges = np.concatenate([[0], np.cumsum(pieces.ravel())]).tolist()
        busy = [row("R", "r", begin, end) for begin, end in zip(edges[1::2], edges[2::2], strict=True)]
        found = told(observe(frame([row("H", "h", 0, edges[-1], execution_id="h"), *busy])))[0][-2]
        assert isinstance(found, dict)
        return found

    first = spent(lengths)
    for _ in range(5):
        assert spent(source.permuted(lengths, axis=0)) == first


def test_a_run_alone_has_the_same_seconds_as_among_others() -> None:
    source = np.random.default_rng(0)
    found = []
    for run in range(60):
        ends = source.integers(1, 10**10, 2).tolist()
        found += [
            row(agent, "t", 0, end, run_id=f"{run:02}", execution_id=agent)
            for agent, end in zip("HR", ends, strict=True)
        ]
    parts = [observe(frame(part)) for part in parts_of(found).values()]
    same(merge(parts), observe(frame(found)))
    for one in observe(frame(found[:2])).executions.to_dicts():
        assert one["duration_s"] in [(own["end_ns"] - own["start_ns"]) / 1e9 for own in found[:2]]


def test_what_has_not_ended_has_not_finished_whatever_it_says() -> None:
    found = [row("H", "h", 0, None, until_ns=SECOND, outcome="succeeded"), row("H", "h", SECOND, 2 * SECOND)]
    assert observe(frame(found)).executions["finished"].to_list() == [False, True]
