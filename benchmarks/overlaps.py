"""Overlapping pairs of executions: our sweep beside polars' range join and a plain Python sweep."""

from __future__ import annotations

import sys

import numpy as np
import polars as pl
from measure import cpu_seconds, peak_mebibytes, table

from hrclog.analyzers.projections.overlaps import sweep


def make_intervals(runs: int, per_agent: int) -> pl.DataFrame:
    """Return two agents' executions, sorted by run and start."""
    random = np.random.default_rng(1)
    lengths = random.lognormal(1.5, 0.4, (runs, 2, per_agent))
    ends = np.cumsum(lengths + 0.5, axis=2)
    starts = ends - lengths
    run = np.repeat(np.arange(runs), 2 * per_agent)
    agent = np.tile(np.repeat(np.arange(2), per_agent), runs)
    columns = {"run": run, "agent": agent, "start": starts.ravel() * 1e9, "end": ends.ravel() * 1e9}
    return pl.DataFrame(columns).cast({"start": pl.Int64, "end": pl.Int64}).sort("run", "start")


def by_join(frame: pl.DataFrame) -> int:
    """Join the two agents with polars' inequality join."""
    left, right = (frame.filter(pl.col("agent") == agent) for agent in (0, 1))
    joined = left.lazy().join_where(
        right.lazy(),
        pl.col("run") == pl.col("run_right"),
        pl.col("start") < pl.col("end_right"),
        pl.col("end") > pl.col("start_right"),
    )
    return joined.collect().height


def by_loop(frame: pl.DataFrame) -> int:
    """Sweep in plain Python."""
    active: list[tuple[int, int, int]] = []
    count = 0
    for run, agent, start, end in frame.select("run", "agent", "start", "end").iter_rows():
        active = [other for other in active if other[0] == run and other[2] > start]
        count += sum(other[1] != agent for other in active)
        active.append((run, agent, end))
    return count


def main(rows: int) -> None:
    """Print the comparison."""
    frame = make_intervals(rows // 24, 12)
    ours = cpu_seconds(lambda: sweep(frame["run"], frame["start"], frame["end"]))
    small = frame.filter(pl.col("run") < max(frame["run"].max() // 10, 1))  # type: ignore[operator]  # an integer column
    scale = frame.height / small.height
    join, loop = cpu_seconds(lambda: by_join(small), 1) * scale, cpu_seconds(lambda: by_loop(small), 1) * scale
    results = [("hrclog sweep", ours), ("polars join_where (scaled)", join), ("Python sweep (scaled)", loop)]
    print(f"{frame.height} executions, peak {peak_mebibytes():.0f} MiB\n")
    print(table(results, "method", frame.height))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 2_400_000)
