"""Segments against a sweep over single nanoseconds, and the laws they obey."""

from __future__ import annotations

from itertools import chain, groupby, pairwise

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from interval_frames import Row, frame, random_runs, row, rows

from hrclog.analyzers.projections.intervals import is_counted
from hrclog.analyzers.projections.joint_states import Segments, State, segments

Piece = tuple[int, int, State]

LONG = 2**61


def cut(intervals: pl.DataFrame, until: list[int] | None = None) -> dict[str, list[Piece]]:
    """Return the pieces of each execution by its id, after checking what must hold of any segments."""
    executions = intervals.filter(is_counted())
    found = segments(executions, intervals, None if until is None else np.array(until, np.int64))
    assert list(found.states) == sorted(set(found.states))
    assert set(found.state.tolist()) == set(range(len(found.states)))
    assert (found.end_ns > found.start_ns).all()
    assert (np.lexsort((found.start_ns, found.row)) == np.arange(len(found.row))).all()
    pieces: dict[str, list[Piece]] = {name: [] for name in executions["execution_id"]}
    for number, low, high, state in zip(*columns(found), strict=True):
        pieces[executions["execution_id"][number]].append((low, high, found.states[state]))
    return pieces


def columns(found: Segments) -> tuple[list[int], ...]:
    return tuple(values.tolist() for values in (found.row, found.start_ns, found.end_ns, found.state))


def by_nanoseconds(found: list[Row], until: dict[str, int] | None = None) -> dict[str, list[Piece]]:
    """Return, execution by execution, which of the others run in each nanosecond, equal neighbours joined."""
    pieces = {}
    for own in found:
        if own["role"] == "auxiliary" or own["parent_execution_id"]:
            continue
        end = own["until_ns"] if until is None else until[own["execution_id"]]
        others = [
            one
            for one in found
            if one["run_id"] == own["run_id"] and one["agent"] != own["agent"] and not one["parent_execution_id"]
        ]
        states = [
            (now - own["start_ns"], state_at(now, others))
            for now in range(own["start_ns"], end)
        ]  # fmt: skip
        joined = []
        for state, group in groupby(states, key=lambda one: one[1]):
            times = [now for now, _ in group]
            joined.append((times[0], times[-1] + 1, state))
        pieces[own["execution_id"]] = joined
    return pieces


def state_at(now: int, others: list[Row]) -> State:
    running = [one for one in others if one["start_ns"] <= now < one["until_ns"]]
    return tuple(sorted((one["agent"], one["task"]) for one in running))


def joined(pieces: dict[str, list[Piece]]) -> dict[str, list[Piece]]:
    """Return pieces with equal neighbours joined: a cut between two executions of the same task tells nothing."""
    found: dict[str, list[Piece]] = {}
    for name, parts in pieces.items():
        whole: list[Piece] = []
        for low, high, state in parts:
            if whole and whole[-1][2] == state:
                assert whole[-1][1] == low
                whole[-1] = (whole[-1][0], high, state)
            else:
                whole.append((low, high, state))
        found[name] = whole
    return found


@pytest.mark.slow
@settings(max_examples=150)
@given(rows(max_size=14))
def test_segments_say_what_the_others_do_in_every_nanosecond(found: list[Row]) -> None:
    assert joined(cut(frame(found))) == by_nanoseconds(found)


@settings(max_examples=60)
@given(rows(max_size=10, agents="ABCD"), st.data())
def test_segments_up_to_another_end_are_those_of_executions_that_end_there(
    found: list[Row], data: st.DataObject
) -> None:
    own = frame(found).filter(is_counted())
    until = [start + data.draw(st.integers(0, 30)) for start in own["start_ns"]]
    expected = by_nanoseconds(found, dict(zip(own["execution_id"], until, strict=True)))
    assert joined(cut(frame(found), until)) == expected


@settings(max_examples=60)
@given(rows(max_size=14))
def test_segments_are_cut_where_something_changes_and_nowhere_else(found: list[Row]) -> None:
    pieces = cut(frame(found))
    for own in found:
        changes = {
            time - own["start_ns"]
            for one in found
            if one["run_id"] == own["run_id"] and one["agent"] != own["agent"] and one["until_ns"] > one["start_ns"]
            for time in (one["start_ns"], one["until_ns"])
        }
        assert {low for low, _, _ in pieces.get(own["execution_id"], [])[1:]} <= changes


@pytest.mark.parametrize(("agents", "itself"), [("HR", ""), ("HRS", "R"), ("HRST", "HRST")])
def test_segments_fill_every_execution_without_gaps(agents: str, itself: str) -> None:
    intervals = frame(random_runs(5, n_runs=8, agents=agents, overlap_itself=itself))
    length = {one["execution_id"]: one["until_ns"] - one["start_ns"] for one in intervals.to_dicts()}
    pieces = cut(intervals)
    assert len(pieces) == intervals.height
    for name, parts in pieces.items():
        assert (parts[0][0], parts[-1][1]) == (0, length[name])
        assert all(one[1] == following[0] for one, following in pairwise(parts))
    # one agent at a time does at most one thing, unless it overlaps itself
    most = max(len([agent for agent, _ in state if agent == "H"]) for _, _, state in chain(*pieces.values()))
    assert most > 1 if "H" in itself else most <= 1


@settings(max_examples=40)
@given(rows(max_size=12), st.randoms(use_true_random=False))
def test_the_order_of_rows_and_the_beginning_of_time_do_not_matter(found: list[Row], source: object) -> None:
    expected = cut(frame(found))
    mixed = frame(found).sample(fraction=1.0, shuffle=True, seed=source.randrange(1000))  # type: ignore[attr-defined] - hypothesis gives a Random
    assert cut(mixed) == expected
    for shift in (-(10**15), 1_700_000_000_123_456_789):
        times = [pl.col(name) + shift for name in ("start_ns", "end_ns", "until_ns")]
        assert cut(frame(found).with_columns(times)) == expected


def test_what_runs_twice_in_one_agent_is_twice_in_the_state() -> None:
    found = [row("H", "h", 0, 10), row("R", "r", 2, 8), row("R", "r", 5, 12)]
    once, twice = (("R", "r"),), (("R", "r"), ("R", "r"))
    assert cut(frame(found))["x0"] == [(0, 2, ()), (2, 5, once), (5, 8, twice), (8, 10, once)]


def test_going_home_is_something_that_the_other_does_and_a_step_of_a_sequence_is_not() -> None:
    found = [
        row("H", "h", 0, 10),
        row("R", "home", 0, 4, role="auxiliary"),
        row("R", "whole", 4, 10),
        row("R", "step", 5, 7, parent_execution_id="x2"),
    ]
    pieces = cut(frame(found))
    assert pieces["x0"] == [(0, 4, (("R", "home"),)), (4, 10, (("R", "whole"),))]
    assert list(pieces) == ["x0", "x2"]


def test_an_open_execution_lasts_until_its_last_sign_of_life() -> None:
    found = [row("H", "h", 0, 10), row("R", "r", 4, None, until_ns=7), row("R", "s", 7, None, until_ns=50)]
    assert cut(frame(found))["x0"] == [(0, 4, ()), (4, 7, (("R", "r"),)), (7, 10, (("R", "s"),))]


def test_executions_of_no_length_have_no_segments_and_cut_nothing_of_others() -> None:
    found = [row("H", "h", 0, 10), row("R", "r", 5, 5), row("S", "s", 7, 7)]
    assert cut(frame(found)) == {"x0": [(0, 10, ())], "x1": [], "x2": []}


@pytest.mark.parametrize("origin", [0, -(2**61), 1_700_000_000_000_000_000])
def test_runs_of_absurd_length_do_not_leak_into_each_other(origin: int) -> None:
    found = []
    for run in "abcde":  # together more than int64 holds
        found += [
            row("H", "h", origin, origin + LONG, run_id=run, execution_id=f"h{run}"),
            row("R", "r", origin + LONG - 3, origin + LONG + 5, run_id=run, execution_id=f"r{run}"),
            row("R", f"only {run}", origin + 7, origin + 9, run_id=run, execution_id=f"o{run}"),
        ]
    pieces = cut(frame(found))
    for run in "abcde":
        mine = (("R", f"only {run}"),)
        assert pieces[f"h{run}"] == [
            (0, 7, ()), (7, 9, mine), (9, LONG - 3, ()), (LONG - 3, LONG, (("R", "r"),)),
        ]  # fmt: skip
        assert pieces[f"r{run}"] == [(0, 3, (("H", "h"),)), (3, 8, ())]


def test_nothing_has_no_segments() -> None:
    assert cut(frame([])) == {}
    assert segments(frame([]), frame([row("H", "h", 0, 1)])).states == ()


def test_names_of_any_kind_are_told_apart() -> None:
    names = ["ü", "u\u0308", "", " ", "☃/1", "a,b", "0"]
    found = [row("H", "h", 0, len(names))]
    found += [row("机器人", name, number, number + 1) for number, name in enumerate(names)]
    assert [state for _, _, state in cut(frame(found))["x0"]] == [(("机器人", name),) for name in names]


def test_some_executions_can_be_cut_alone() -> None:
    intervals = frame(random_runs(3, n_runs=4, agents="HRS"))
    whole = cut(intervals)
    some = intervals.filter(pl.col("agent") == "R")[5:9]
    found = segments(some, intervals)
    for number, name in enumerate(some["execution_id"]):
        mine = found.row == number
        states = [found.states[state] for state in found.state[mine]]
        assert list(zip(found.start_ns[mine], found.end_ns[mine], states, strict=True)) == whole[name]
