"""Runs in which too much overlaps are told apart by counts alone, whatever else is analysed with them."""

from __future__ import annotations

import polars as pl
from hypothesis import given
from hypothesis import strategies as st

from hrclog.analyzers.projections import crowded
from hrclog.analyzers.projections.crowded import crowded_runs, without_crowded
from hrclog.analyzers.projections.overlaps import overlaps
from hrclog.analyzers.projections.schemas import INTERVALS
from hrclog.analyzers.synergy.observations import observe

ROWS = st.lists(st.tuples(st.integers(0, 3), st.integers(0, 30), st.integers(0, 30)), max_size=30)


def frame(rows: list[tuple[str, str, int, int]]) -> pl.DataFrame:
    """Return intervals of (run, agent, start, length)."""
    columns = [
        {
            "run_id": run,
            "agent": agent,
            "task": "t",
            "role": "primary",
            "execution_id": f"e{number}",
            "parent_execution_id": "",
            "attempt": 1,
            "start_ns": start,
            "end_ns": start + length,
            "until_ns": start + length,
            "outcome": "succeeded",
        }
        for number, (run, agent, start, length) in enumerate(rows)
    ]
    return pl.DataFrame(columns, schema_overrides=INTERVALS).pipe(
        lambda made: pl.concat([INTERVALS.to_frame(), made], how="diagonal")
    )


@given(ROWS)
def test_overlaps_are_counted_as_the_sweep_finds_them(rows: list[tuple[int, int, int]]) -> None:
    intervals = frame([(f"r{run}", "a", start, length + 1) for run, start, length in rows]).sort("run_id")
    number = intervals["run_id"].rle_id().to_numpy().astype("int64")
    met = crowded._met(number, intervals["start_ns"].to_numpy(), intervals["until_ns"].to_numpy())
    pairs = overlaps(intervals)
    found = [pairs.filter(pl.col("execution_id") == name).height for name in intervals["execution_id"]]
    assert met.tolist() == found


def test_a_crowded_run_is_left_out_and_the_others_are_what_they_are_alone() -> None:
    good = [("good", agent, 10 * at, 8) for at in range(20) for agent in ("a", "b")]
    crowd = [("crowd", "a", at, 10**6) for at in range(200)]
    both = frame(good + crowd)
    assert crowded_runs(both) == {"crowd": "19,900 pairs of its executions overlap"}
    alone = both.filter(pl.col("run_id") == "good")
    assert without_crowded(both).equals(alone)
    assert overlaps(both).equals(overlaps(alone))
    assert observe(both).executions.equals(observe(alone).executions)


def test_many_agents_make_a_run_crowded_and_many_executions_alone_do_not() -> None:
    assert crowded_runs(frame([("r", f"a{number}", number, 1) for number in range(51)])) == {
        "r": "it has 51 agents, expected at most 50"
    }
    assert crowded_runs(frame([("r", f"a{number % 50}", number, 3) for number in range(2000)])) == {}
    assert crowded_runs(INTERVALS.to_frame()) == {}
