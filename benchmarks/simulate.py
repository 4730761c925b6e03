"""How fast the stepped cell is: simulated seconds per CPU second under each policy, wall time of 50 runs.

python benchmarks/simulate.py [--runs 50]
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path

from hrclog.log.reader import read_events
from hrclog.sim.bullet.engine import with_policy
from hrclog.sim.campaign import simulate_campaign
from hrclog.sim.cell.safety_settings import POLICIES
from hrclog.sim.scenario import Scenario, load_scenario


def main() -> None:
    """Simulate campaigns of the paper's cell with all signals, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=50)
    runs = parser.parse_args().runs
    print(f"| policy | simulated s per CPU s | {runs} runs, 1 worker (wall s) | {runs} runs, 2 workers (wall s) |")
    print("| --- | --- | --- | --- |")
    for policy in POLICIES:
        scenario = with_policy(load_scenario("paper"), policy)
        simulated_s, cpu_s, alone_s = campaign(scenario, runs, 1)
        _, _, together_s = campaign(scenario, runs, 2)
        print(f"| {policy} | {simulated_s / cpu_s:.0f} | {alone_s:.0f} | {together_s:.0f} |")


def campaign(scenario: Scenario, runs: int, workers: int) -> tuple[float, float, float]:
    """Return simulated seconds, CPU seconds of this process, and wall seconds of a campaign with all signals on."""
    with tempfile.TemporaryDirectory() as folder:
        before, began = os.times(), time.perf_counter()
        paths = simulate_campaign(scenario, runs, 1, Path(folder), workers, engine="bullet")
        after, ended = os.times(), time.perf_counter()
        simulated_s = sum(span_s(path) for path in paths)
    cpu_s = after.user + after.system - before.user - before.system
    return simulated_s, cpu_s, ended - began


def span_s(path: Path) -> float:
    """Return how long a run took in its own time."""
    times = read_events([path])["time_ns"].to_numpy()
    return float(times.max() - times.min()) / 1e9


if __name__ == "__main__":
    main()
