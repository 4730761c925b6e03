"""Recordings and the report: CPU time and bytes, beside logging a run to Rerun one event at a time."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import rerun as rr
from measure import cpu_seconds

from hrclog.analyzers.analysis import analyze
from hrclog.analyzers.figures.gantt import Gantt, state_changes
from hrclog.analyzers.output import save
from hrclog.analyzers.result import Analysis

NAIVE_RUNS = 20
"""Runs that are logged one event at a time; more would only take longer."""


def main(logs: list[str]) -> None:
    """Print tables for the folders given, else for simulated campaigns of 50 and 1,000 runs."""
    with tempfile.TemporaryDirectory() as scratch:
        folders = [Path(log) for log in logs] or [_simulated(Path(scratch), runs) for runs in (50, 1000)]
        rows = [_measured(folder, Path(scratch) / f"out{at}") for at, folder in enumerate(folders)]
        print("| runs | intervals | campaign.rrd CPU s | runs/*.rrd CPU s | bytes per interval | report CPU s | MB |")
        print("| --- | --- | --- | --- | --- | --- | --- |")
        print("\n".join(rows))
        print()
        print(_columns_against_events(analyze(folders[0])))


def _simulated(scratch: Path, runs: int) -> Path:
    folder = scratch / str(runs)
    command = [sys.executable, "-m", "hrclog", "sim", "--runs", str(runs), "-o", str(folder)]
    subprocess.run(command, check=True, capture_output=True)
    return folder


def _measured(folder: Path, output: Path) -> str:
    analysis = analyze(folder)
    output.mkdir()
    campaign = cpu_seconds(lambda: analysis.to_rerun(output / "campaign.rrd"), 2)
    everything = cpu_seconds(lambda: save(analysis, output, most_recordings=None), 1)
    report = cpu_seconds(lambda: analysis.to_report(output / "report.html"), 1)
    runs = sum(path.stat().st_size for path in (output / "runs").glob("*.rrd"))
    size = (output / "report.html").stat().st_size / 1e6
    intervals = analysis.intervals.height
    return (
        f"| {analysis.runs.height:,} | {intervals:,} | {campaign:.2f} | {everything - campaign:.2f} | "
        f"{runs / intervals:,.0f} | {report:.2f} | {size:.1f} |"
    )


def _columns_against_events(analysis: Analysis) -> str:
    """Return CPU time and bytes of the lanes of some runs, sent as columns and one event at a time."""
    runs = analysis.runs["run_id"].to_list()[:NAIVE_RUNS]
    gantts = [analysis.run_figures(run).gantt for run in runs]
    bars = sum(len(lane.bars) for gantt in gantts for lane in gantt.lanes)
    rows = []
    for name, send in (("columns", _send_columns), ("one call per event", _send_events)):
        sizes: list[int] = []
        cost = cpu_seconds(lambda send=send, sizes=sizes: sizes.append(sum(send(gantt) for gantt in gantts)))  # type: ignore[misc]  # bound at once
        rows.append((name, cost, sizes[-1]))
    first = rows[0][1]
    lines = [f"| {bars:,} bars of {len(gantts)} runs | CPU s | ratio | bytes per bar |", "| --- | --- | --- | --- |"]
    lines += [f"| {name} | {cost:.3f} | {cost / first:.1f} | {size / bars:,.0f} |" for name, cost, size in rows]
    return "\n".join(lines)


def _send_columns(gantt: Gantt) -> int:
    rec = rr.RecordingStream("benchmark", send_properties=False)
    memory = rec.memory_recording()
    for number, lane in enumerate(gantt.lanes):
        instants, states = state_changes(lane)
        index = rr.TimeColumn("run_time", duration=np.asarray(instants, np.int64).astype("timedelta64[ns]"))
        rec.send_columns(f"/timeline/{number}", [index], rr.StateChange.columns(state=states))
    return len(memory.drain_as_bytes())


def _send_events(gantt: Gantt) -> int:
    rec = rr.RecordingStream("benchmark", send_properties=False)
    memory = rec.memory_recording()
    for number, lane in enumerate(gantt.lanes):
        for instant, state in zip(*state_changes(lane), strict=True):
            rec.set_time("run_time", duration=np.timedelta64(instant, "ns"))
            rec.log(f"/timeline/{number}", rr.StateChange(state=state))
    return len(memory.drain_as_bytes())


if __name__ == "__main__":
    main(sys.argv[1:])
