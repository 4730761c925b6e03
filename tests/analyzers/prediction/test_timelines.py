"""Work along the others' timelines against a sum over small steps, and what a forecast may not depend on."""

from __future__ import annotations

import math

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from interval_frames import Row, frame, random_runs, row, rows

from hrclog.analyzers.prediction.timelines import Timeline, Timelines
from hrclog.analyzers.projections.intervals import is_counted
from hrclog.analyzers.projections.joint_states import AgentTask
from hrclog.analyzers.synergy.exposures import exposures
from hrclog.analyzers.synergy.observations import observe

S = 1_000_000_000
AGENTS = "ABC"
KEYS = [(agent, task) for agent in AGENTS for task in "xyz"]
LOG_FACTORS = st.fixed_dictionaries({}, optional={key: st.floats(-1.5, 1.5) for key in KEYS})


def timelines(found: list[Row]) -> tuple[pl.DataFrame, Timelines]:
    intervals = frame(found)
    executions = intervals.filter(is_counted())
    return executions, Timelines(executions, intervals)


def work_by_steps(own: Row, found: list[Row], factors: dict[AgentTask, float], seconds: int) -> float:
    """Return work after whole seconds of rows on a grid of whole seconds, second by second."""
    work = 0.0
    for now in range(own["start_ns"], own["start_ns"] + seconds * S, S):
        others = [
            factors.get((one["agent"], one["task"]), 0.0)
            for one in found
            if one["run_id"] == own["run_id"]
            and one["agent"] != own["agent"]
            and not one["parent_execution_id"]
            and one["start_ns"] <= now < one["until_ns"]
        ]
        work += math.exp(-sum(others))
    return work


@settings(max_examples=60)
@given(rows(max_size=10, scale=S), LOG_FACTORS, st.integers(0, 45))
def test_work_is_the_integral_of_the_rate_over_whatever_the_others_do(
    found: list[Row], factors: dict[AgentTask, float], seconds: int
) -> None:
    executions, lines = timelines(found)
    for number, own in enumerate(executions.iter_rows(named=True)):
        line = lines.along(number, factors)
        expected = work_by_steps(own, found, factors, seconds)
        assert line.work_after(float(seconds)) == pytest.approx(expected, rel=1e-9, abs=1e-9)


@settings(max_examples=60)
@given(rows(max_size=10, scale=S), LOG_FACTORS, st.lists(st.floats(1e-9, 1e4), min_size=1, max_size=5))
def test_the_time_for_work_and_the_work_after_a_time_are_inverse(
    found: list[Row], factors: dict[AgentTask, float], values: list[float]
) -> None:
    executions, lines = timelines(found)
    for number in range(executions.height):
        line = lines.along(number, factors)
        times = line.time_for(np.array(values))
        assert [line.work_after(float(time)) for time in times] == pytest.approx(values, rel=1e-9)
        works = np.array([line.work_after(value) for value in values])
        assert line.time_for(works) == pytest.approx(values, rel=1e-9)


def test_work_along_the_whole_execution_is_the_work_that_estimators_see() -> None:
    intervals = frame(random_runs(3, n_runs=6, agents="HRS", overlap_itself="R"))
    source = np.random.default_rng(1)
    factors = {key: float(source.normal(0, 0.5)) for key in intervals.select("agent", "task").unique().rows()}
    executions = observe(intervals).executions
    lines = Timelines(
        executions.join(intervals, on=["run_id", "execution_id"], how="left", maintain_order="left"), intervals
    )
    found: dict[AgentTask, list[float]] = {}
    for number, (agent, task, duration) in enumerate(executions.select("agent", "task", "duration_s").rows()):
        found.setdefault((agent, task), []).append(lines.along(number, factors).work_after(duration))
    for data in exposures(observe(intervals)):
        assert data.work(data.log_factors(factors)) == pytest.approx(found[data.key], rel=1e-12)


def test_beyond_the_last_thing_the_others_do_they_idle() -> None:
    _, lines = timelines([row("H", "h", 0, 2 * S), row("R", "r", 1 * S, 4 * S)])
    line = lines.along(0, {("R", "r"): math.log(3)})
    assert line.work_after(4) == pytest.approx(1 + 3 / 3)
    assert line.work_after(104) == pytest.approx(2 + 100)
    assert line.time_for(np.array([102.0])) == pytest.approx([104])
    assert line.log_factor_before(50) == 0


def test_with_nobody_else_work_is_time() -> None:
    _, lines = timelines([row("H", "h", 5, 5 + 2 * S), row("H", "h", 9 * S, 10 * S)])
    for number in (0, 1):
        line = lines.along(number, {("H", "h"): 1.0})
        for duration in (1e-9, 0.5, 2.0, 1e6):
            assert line.work_after(duration) == pytest.approx(duration, rel=1e-12)
            assert line.log_factor_before(duration) == 0


def test_an_execution_that_starts_when_the_run_ends_has_an_empty_timeline() -> None:
    _, lines = timelines([row("R", "r", 0, S), row("H", "h", S, S)])
    line = lines.along(1, {("R", "r"): 1.0})
    assert (len(line.time_s), len(line.log_factor)) == (1, 0)
    assert (line.work_after(3.0), line.log_factor_before(3.0)) == (3.0, 0.0)


def test_the_factor_before_an_instant_is_that_of_the_segment_it_ends() -> None:
    line = Timeline(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 1.5]), np.array([0.1, 0.2]))
    assert [line.log_factor_before(at) for at in (1e-9, 0.5, 1.0, 1.5, 2.0, 2.5)] == [0.1, 0.1, 0.1, 0.2, 0.2, 0.0]


@pytest.mark.parametrize("n_items", [6, 80])
def test_how_long_the_execution_itself_takes_changes_nothing(n_items: int) -> None:
    others = [row("R", f"r{n % 3}", n * 2 * S, (2 * n + 1) * S, execution_id=f"o{n}") for n in range(n_items)]
    factors = {("R", f"r{n}"): 0.5 * (n + 1) for n in range(3)}
    work = np.geomspace(0.01, 15 if n_items > 50 else 1000, 40)
    executions, _ = timelines([row("H", "h", 3 * S, 5 * S), *others])
    own = executions["agent"].to_list().index("H")
    times = [
        timelines([row("H", "h", 3 * S, end), *others])[1].along(own, factors).time_for(work)
        for end in (4 * S - 1, 5 * S, 7 * S + 1, 10_000 * S)
    ]
    for other in times[1:]:
        assert other == pytest.approx(times[0], rel=1e-12)


def test_the_same_agents_other_executions_change_nothing() -> None:
    own, other = row("H", "h", 3 * S, 9 * S), row("R", "r", 5 * S, 8 * S)
    factors = {("R", "r"): 1.0, ("H", "h"): 2.0, ("H", "g"): 3.0}
    expected = timelines([own, other])[1].along(0, factors)
    for more in (
        row("H", "g", 4 * S, 6 * S),
        row("H", "h", 9 * S, 99 * S),
        row("H", "g", 9 * S, None, until_ns=20 * S),
    ):
        line = timelines([own, other, more])[1].along(0, factors)
        work = np.linspace(0.1, 50, 30)
        assert line.time_for(work) == pytest.approx(expected.time_for(work), rel=1e-12)


def test_runs_do_not_see_each_other() -> None:
    found = [row("H", "h", 0, S, run_id="a"), row("R", "r", 0, S, run_id="b")]
    for number in (0, 1):
        assert timelines(found)[1].along(number, dict.fromkeys((("H", "h"), ("R", "r")), 1.0)).work_after(5.0) == 5.0


def test_clocks_that_begin_in_1970_do_not_overflow() -> None:
    now = 1_700_000_000 * S
    found = [row("R", "r", 0, now + S), *(row("H", "h", now + n * S, now + (n + 1) * S) for n in range(120))]
    for some in (found[:3], found):
        executions, lines = timelines(some)
        own = executions["agent"].to_list().index("H")
        assert lines.along(own, {("R", "r"): math.log(2)}).work_after(0.5) == pytest.approx(0.25)


def test_very_long_runs_are_looked_through_for_ten_times_their_longest_execution() -> None:
    found = [row("R", "r", n * 2 * S, (2 * n + 1) * S) for n in range(200)] + [row("H", "h", 0, 2 * S)]
    executions, lines = timelines(found)
    own = executions["agent"].to_list().index("H")
    assert lines.along(own, {}).time_s[-1] == 20.0
