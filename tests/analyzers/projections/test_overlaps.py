"""Overlaps against the one formula, applied to every pair."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from interval_frames import Row, frame, random_runs, row, rows
from polars.testing import assert_frame_equal

from hrclog.analyzers.projections import overlaps as module
from hrclog.analyzers.projections.intervals import intervals
from hrclog.analyzers.projections.overlaps import overlaps, pair_overlaps, sweep, task_pairs
from hrclog.analyzers.projections.schemas import OVERLAPS, PAIR_OVERLAPS
from hrclog.event_rows import to_row
from hrclog.events import TaskStarted
from hrclog.log.messages.decode import frame_of_rows

Pairs = dict[tuple[str, str, str], int]


def counts(one: Row) -> bool:
    return one["role"] == "primary" and not one["parent_execution_id"]


def every_pair(found: list[Row]) -> Pairs:
    """Return (run, execution, other execution) -> overlap, by the formula."""
    pairs = {}
    for k, c in permutations([one for one in found if counts(one)], 2):
        overlap = min(k["until_ns"], c["until_ns"]) - max(k["start_ns"], c["start_ns"])
        if k["run_id"] == c["run_id"] and overlap > 0:
            pairs[k["run_id"], k["execution_id"], c["execution_id"]] = overlap
    return pairs


def as_pairs(found: pl.DataFrame) -> Pairs:
    columns = found.select("run_id", "execution_id", "other_execution_id", "overlap_ns").rows()
    assert len({one[:3] for one in columns}) == len(columns)
    return {one[:3]: one[3] for one in columns}


@settings(max_examples=100)
@given(rows())
def test_overlaps_are_those_of_the_formula_for_every_pair(found: list[Row]) -> None:
    result = overlaps(frame(found))
    assert result.schema == OVERLAPS
    assert as_pairs(result) == every_pair(found)
    of = {one["execution_id"]: one for one in found}
    for one in result.to_dicts():
        k, c = of[one["execution_id"]], of[one["other_execution_id"]]
        assert (one["agent"], one["task"], one["other_agent"], one["other_task"]) == (
            k["agent"],
            k["task"],
            c["agent"],
            c["task"],
        )
        assert one["ratio"] == one["overlap_ns"] / (k["until_ns"] - k["start_ns"])


@settings(max_examples=40)
@given(rows())
def test_overlap_is_symmetric(found: list[Row]) -> None:
    pairs = as_pairs(overlaps(frame(found)))
    assert pairs == {(run, c, k): overlap for (run, k, c), overlap in pairs.items()}


@settings(max_examples=50)
@given(rows(max_size=10), st.integers(1, 5))
def test_where_the_blocks_are_cut_changes_nothing(found: list[Row], size: int) -> None:
    whole = overlaps(frame(found))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_BLOCK_ROWS", size)
        assert_frame_equal(overlaps(frame(found)), whole)


@settings(max_examples=60)
@given(rows(plain=True))
def test_the_ratios_against_one_agent_sum_to_one_at_most_unless_it_overlaps_itself(found: list[Row]) -> None:
    result = overlaps(frame(found))
    both_hands = set(result.filter(pl.col("agent") == pl.col("other_agent")).select("run_id", "agent").rows())
    sums = result.group_by("run_id", "agent", "execution_id", "other_agent").agg(pl.col("ratio").sum())
    for run, agent, _, other, total in sums.iter_rows():
        assert agent == other or total <= 1 + 1e-12 or (run, other) in both_hands


@settings(max_examples=60)
@given(rows())
def test_the_pair_table_sums_the_formula_and_averages_over_all_executions(found: list[Row]) -> None:
    counted = [one for one in found if counts(one)]
    tasks = {(one["agent"], one["task"]) for one in counted}
    table = pair_overlaps(frame(found), overlaps(frame(found)))
    assert table.schema == PAIR_OVERLAPS
    keys = table.select("agent", "task", "other_agent", "other_task").rows()
    assert keys == sorted(one + other for one in tasks for other in tasks if one[0] != other[0])
    of = {one["execution_id"]: one for one in found}
    for agent, task, other_agent, other_task, total, n, ratio in table.iter_rows():
        pairs = [
            (overlap, overlap / (of[k]["until_ns"] - of[k]["start_ns"]))
            for (_, k, c), overlap in every_pair(found).items()
            if (of[k]["agent"], of[k]["task"], of[c]["agent"], of[c]["task"]) == (agent, task, other_agent, other_task)
        ]
        executions = sum((one["agent"], one["task"]) == (agent, task) for one in counted)
        assert n == len(pairs)
        assert total == pytest.approx(sum(pair[0] for pair in pairs) / 1e9, rel=1e-12)
        assert ratio == pytest.approx(sum(pair[1] for pair in pairs) / executions, rel=1e-12)


def test_touching_executions_do_not_overlap() -> None:
    assert overlaps(frame([row("A", "x", 0, 5), row("B", "y", 5, 9)])).height == 0


def test_an_execution_of_no_length_overlaps_nothing() -> None:
    assert overlaps(frame([row("A", "x", 0, 5), row("B", "y", 2, 2), row("C", "y", 0, 0)])).height == 0


def test_an_open_execution_overlaps_until_the_end_of_its_run() -> None:
    open_one = row("A", "x", 0, None, until_ns=50, outcome="unknown")
    assert overlaps(frame([open_one, row("B", "y", 40, 60)]))["overlap_ns"].to_list() == [10, 10]


@pytest.mark.parametrize("overlap_itself", ["", "R"])
def test_many_long_runs_agree_with_the_formula(overlap_itself: str) -> None:
    found = random_runs(3, n_runs=12, per_agent=12, agents="HRS", overlap_itself=overlap_itself)
    assert as_pairs(overlaps(frame(found))) == every_pair(found)


def test_runs_with_clocks_gone_wrong_are_still_right() -> None:
    now = 1_700_000_000_000_000_000
    spans = [("A", "x", 0, now), ("B", "y", now - 7, now + 9), ("C", "z", -now, -now + 5)]
    found = [
        row(*span, run_id=f"run{run}", execution_id=f"{run}-{number}")
        for run in range(20)
        for number, span in enumerate(spans)
    ]
    assert as_pairs(overlaps(frame(found))) == every_pair(found)
    assert len(every_pair(found)) == 40


def test_a_sweep_over_nothing_finds_nothing() -> None:
    nothing = pl.Series([], dtype=pl.Int64)
    assert [len(part) for part in sweep(pl.Series([], dtype=pl.String), nothing, nothing)] == [0, 0, 0]
    assert pair_overlaps(frame([]), overlaps(frame([]))).height == 0


def test_mean_ratio_does_not_depend_on_the_order_in_which_rows_come() -> None:
    rows_of = frame(random_runs(5, n_runs=30, per_agent=20))
    found = overlaps(rows_of)
    order = np.random.default_rng(0).permutation(found.height)
    assert_frame_equal(pair_overlaps(rows_of, found), pair_overlaps(rows_of, found[order]), check_exact=True)


def test_executions_that_never_ended_do_not_overlap_everything_after_them() -> None:
    starts = [("HR"[number % 2], 10 * (number // 2)) for number in range(600)]
    events = [
        TaskStarted(time_ns=start, seq=number, run_id="r", agent=agent, task="t", execution_id=f"e{number}")
        for number, (agent, start) in enumerate(starts)
    ]
    found = frame_of_rows([to_row(event) | {"log_time_ns": 0} for event in events]).with_columns(path=pl.lit("x"))
    assert overlaps(intervals(found)).height <= 2 * len(starts)


def test_with_too_many_tasks_only_the_observed_pairs_are_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    tasks = pl.DataFrame({"agent": ["A", "A", "B"], "task": ["x", "y", "x"], "executions": [1, 2, 3]})
    observed = pl.DataFrame({"agent": ["B"], "task": ["x"], "other_agent": ["A"], "other_task": ["y"]})
    assert task_pairs(tasks, observed).height == 4
    monkeypatch.setattr(module, "MOST_PAIRS", 3)
    assert task_pairs(tasks, observed).rows() == [("B", "x", "A", "y", 3)]
