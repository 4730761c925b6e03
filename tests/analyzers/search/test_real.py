"""Plans of the authors' online runs, judged by what their offline runs taught."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import polars as pl
import pytest

from hrclog.analyzers.learning.learn import learn
from hrclog.analyzers.search.encoded import Encoded, encode_queues
from hrclog.analyzers.search.evaluate import evaluate
from hrclog.analyzers.search.worlds import expected_world
from hrclog.arrays import FloatArray

if TYPE_CHECKING:
    from conftest import Runs

pytestmark = pytest.mark.slow

PLANNERS = ("BASIC", "NOT_NEIGHBORING", "RELAXED", "COMPLETE")
"""From the slowest to the fastest, as they turned out."""

Carried = tuple[str, list[FloatArray], list[list[str]], float]
"""The planner of a run; of each agent the planned starts and the tasks; how long the run took."""


def carried_out(online: Runs) -> Iterator[Carried]:
    """Yield the runs in time order, instants in seconds since their first start."""
    started = online.events.filter(kind="run_started").select("run_id", "details")
    names = {run: json.loads(details)["name"] for run, details in started.iter_rows()}
    rows = online.intervals.sort("start_ns")
    for (run,), run_rows in rows.group_by("run_id", maintain_order=True):
        zero = run_rows["start_ns"].to_numpy().min()
        by_agent = [run_rows.filter(agent=agent) for agent in agents_of(online)]
        planned = [(part["planned_start_ns"].to_numpy() - zero) / 1e9 for part in by_agent]
        took_s = (run_rows["end_ns"].to_numpy().max() - zero) / 1e9
        planner = next(one for one in PLANNERS if one in names[run])
        yield planner, planned, [part["task"].to_list() for part in by_agent], took_s


def agents_of(online: Runs) -> list[str]:
    return sorted(online.intervals["agent"].unique())


def encoded(online: Runs, runs: list[Carried], keys: list[tuple[str, str]]) -> Encoded:
    """Return the plans of the runs, no item before its planned start."""
    agents = agents_of(online)
    plans = encode_queues(agents, keys, [dict(zip(agents, tasks, strict=True)) for _, _, tasks, _ in runs])
    not_before = np.zeros(plans.task.shape)
    for index, (_, planned, _, _) in enumerate(runs):
        for place, instants in enumerate(planned):
            not_before[index, place, : len(instants)] = instants
    return replace(plans, not_before_s=not_before)


@pytest.fixture(scope="module")
def expected(offline: Runs, online: Runs) -> pl.DataFrame:
    """Return the planner of each online run, how long it took, and how long it was expected to take."""
    times = learn(offline.intervals).times
    runs, keys = list(carried_out(online)), sorted(times.times)
    plans = encoded(online, runs, keys)
    world = expected_world(times, keys, plans.agents, plans.task.shape[-1])
    return pl.DataFrame(
        {
            "planner": [planner for planner, *_ in runs],
            "took_s": [took_s for *_, took_s in runs],
            "expected_s": evaluate(plans, world).makespan_s[:, 0],
        }
    )


def test_the_authors_four_planners_come_in_their_true_order(expected: pl.DataFrame) -> None:
    means = expected.group_by("planner").agg(pl.col("took_s", "expected_s").mean(), pl.len())
    assert means["len"].sum() == 200
    for column in ("took_s", "expected_s"):
        assert means.sort(column, descending=True)["planner"].to_list() == list(PLANNERS)


def test_runs_that_are_expected_to_take_longer_do(expected: pl.DataFrame) -> None:
    rho = expected.select(pl.corr("took_s", "expected_s", method="spearman")).item()
    assert rho >= 0.85


def test_without_what_agents_do_to_each_other_runs_are_told_apart_less_well(
    offline: Runs, online: Runs, expected: pl.DataFrame
) -> None:
    times = learn(offline.intervals).times
    runs, keys = list(carried_out(online)), sorted(times.times)
    plans = replace(encoded(online, runs, keys), not_before_s=None)
    size = plans.task.shape[-1]
    found = {
        synergies: evaluate(plans, expected_world(times, keys, plans.agents, size, synergies=synergies)).makespan_s[
            :, 0
        ]
        for synergies in (True, False)
    }
    rho = {
        synergies: expected.select(pl.corr(pl.col("took_s"), pl.Series(values), method="spearman")).item()
        for synergies, values in found.items()
    }
    assert rho[True] > rho[False] + 0.1
