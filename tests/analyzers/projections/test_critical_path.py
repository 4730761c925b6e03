"""Critical paths against every path there is."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from interval_frames import Row, frame, row, rows

from hrclog.analyzers.projections.critical_path import Precedence, critical_path, critical_path_lengths
from hrclog.analyzers.projections.intervals import SORT
from hrclog.analyzers.projections.schemas import CRITICAL_PATH

items = st.sampled_from(("", "i", "j", "k"))
precedences = st.lists(st.tuples(st.sampled_from("ijk"), st.sampled_from("ijk")), max_size=4)


@st.composite
def runs_of_items(draw: st.DrawFn) -> list[Row]:
    # few agents in one run, so that there are chains; and now and then two runs
    found = draw(st.one_of(rows(max_size=9, runs="r", agents="A"), rows(max_size=9, runs="r", agents="AB"), rows()))
    return [one | {"item_id": draw(items)} for one in found]


def longest_paths(found: list[Row], declared: list[Precedence]) -> dict[str, tuple[int, int]]:
    """Return execution -> (longest path before it, longest path from its start on), by trying every edge."""
    nodes = [one for one in frame(found).sort(SORT).to_dicts() if not one["parent_execution_id"]]
    length = [one["until_ns"] - one["start_ns"] for one in nodes]

    @cache
    def edge(k: int, c: int) -> bool:
        one, other = nodes[k], nodes[c]
        tied = one["agent"] == other["agent"] or (one["item_id"], other["item_id"]) in declared
        return k < c and one["run_id"] == other["run_id"] and tied and one["until_ns"] <= other["start_ns"]

    @cache
    def before(c: int) -> int:
        return max((before(k) + length[k] for k in range(c) if edge(k, c)), default=0)

    @cache
    def onwards(k: int) -> int:
        return length[k] + max((onwards(c) for c in range(k + 1, len(nodes)) if edge(k, c)), default=0)

    return {nodes[n]["execution_id"]: (before(n), onwards(n)) for n in range(len(nodes))}


@settings(max_examples=100)
@given(runs_of_items(), precedences)
def test_earliest_latest_and_slack_are_those_of_the_longest_paths(found: list[Row], declared: list[Precedence]) -> None:
    schedule = critical_path(frame(found), declared)
    assert schedule.schema == CRITICAL_PATH
    paths = longest_paths(found, declared)
    assert set(schedule["execution_id"]) == set(paths)
    run_of = {one["execution_id"]: one["run_id"] for one in found}
    longest = {
        run: max(sum(path) for name, path in paths.items() if run_of[name] == run)
        for run in {run_of[name] for name in paths}
    }
    assert critical_path_lengths(schedule) == longest
    for one in schedule.to_dicts():
        before, onwards = paths[one["execution_id"]]
        assert one["earliest_start_ns"] == before
        assert one["latest_start_ns"] == longest[one["run_id"]] - onwards
        assert one["slack_ns"] == one["latest_start_ns"] - one["earliest_start_ns"]
        assert one["critical"] == (one["slack_ns"] == 0)
        assert one["latest_end_ns"] - one["earliest_end_ns"] == one["slack_ns"]


def test_without_precedences_the_busiest_agent_is_the_critical_path() -> None:
    found = [row("H", "a", 0, 6), row("H", "b", 8, 10), row("R", "c", 1, 6), row("R", "d", 6, 7)]
    schedule = critical_path(frame(found))
    assert critical_path_lengths(schedule) == {"run": 8}
    assert schedule.filter("critical")["task"].to_list() == ["a", "b"]
    assert schedule.filter(~pl.col("critical"))["slack_ns"].to_list() == [2, 2]


def test_a_precedence_joins_the_chains_of_two_agents() -> None:
    found = [
        row("H", "a", 0, 6, item_id="i"),
        row("H", "b", 6, 8),
        row("R", "c", 0, 1),
        row("R", "d", 6, 13, item_id="j"),
    ]
    assert critical_path_lengths(critical_path(frame(found))) == {"run": 8}
    schedule = critical_path(frame(found), [("i", "j")])
    assert critical_path_lengths(schedule) == {"run": 13}
    assert schedule.filter("critical")["task"].to_list() == ["a", "d"]


def test_a_precedence_that_the_run_broke_is_no_edge() -> None:
    found = [row("H", "a", 0, 6, item_id="i"), row("R", "d", 5, 13, item_id="j")]
    assert critical_path_lengths(critical_path(frame(found), [("i", "j")])) == {"run": 8}


def test_a_short_chain_that_ends_later_does_not_hide_a_long_one() -> None:
    found = [row("H", "a", 0, 10), row("H", "b", 9, 11), row("H", "c", 12, 15)]
    schedule = critical_path(frame(found))
    assert schedule["earliest_start_ns"].to_list() == [0, 0, 10]
    assert schedule["slack_ns"].to_list() == [0, 8, 0]


def test_two_hands_of_one_agent_are_no_chain() -> None:
    assert critical_path_lengths(critical_path(frame([row("H", "a", 0, 6), row("H", "b", 1, 8)]))) == {"run": 7}


@pytest.mark.parametrize("order", [lambda found: found, lambda found: found[::-1]])
def test_executions_of_no_length_neither_block_nor_hide_a_chain(order: Callable[[list[Row]], list[Row]]) -> None:
    found = [row("H", "a", 0, 5), row("H", "b", 5, 5), row("H", "c", 5, 5), row("H", "d", 5, 9)]
    schedule = critical_path(frame(order(found)))
    assert critical_path_lengths(schedule) == {"run": 9}
    assert schedule["slack_ns"].to_list() == [0, 0, 0, 0]


def test_a_chain_passes_through_an_execution_of_no_length() -> None:
    found = [row("H", "a", 0, 5), row("H", "b", 5, 5, item_id="i"), row("R", "d", 5, 9, item_id="j")]
    schedule = critical_path(frame(found), [("i", "j")])
    assert critical_path_lengths(schedule) == {"run": 9}
    assert schedule["slack_ns"].to_list() == [0, 0, 0]


def test_no_executions_have_no_critical_path() -> None:
    schedule = critical_path(frame([]))
    assert (schedule.height, schedule.schema, critical_path_lengths(schedule)) == (0, CRITICAL_PATH, {})
