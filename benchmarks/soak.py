"""A recorder that runs for days: is memory flat, and how long does a sample take?

`python benchmarks/soak.py --hours 24` records two agents at 50 Hz through a `Recorder` with a simulated clock, as fast
as the disk takes it, in a folder that is removed afterwards, and prints a row per tenth of the time. It exits with 1 if
memory grew.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from hrclog.recorders.recorder import Recorder

BEGAN_NS: Final = 1_700_000_000 * 10**9
TASK_S: Final = 20.0
MOST_GROWTH_MB: Final = 16.0
_STATUS: Final = Path("/proc/self/statm")
_PAGE_MB: Final = 4096 / 1e6


@dataclass(frozen=True, slots=True)
class Mark:
    """Where a soak stands: simulated hours, samples, memory of the process, CPU time per sample."""

    hours: float
    n_samples: int
    memory_mb: float
    sample_us: float
    cpu_s: float


def soak(path: Path, hours: float, rate_hz: float = 50.0, n_marks: int = 10, *, close: bool = False) -> Iterator[Mark]:
    """Record two agents that work and are sampled, with a simulated clock; yield marks on the way.

    Args:
        path: of the log.
        hours: to be simulated.
        rate_hz: of the samples of either agent.
        n_marks: how many marks.
        close: whether to close the run at the end; its journal is rewritten as a whole then.
    """
    now_ns = [BEGAN_NS]
    recorder = Recorder(path, agents=("robot", "human"), clock_ns=lambda: now_ns[0])
    n_ticks = round(hours * 3600 * rate_hz)
    per_task = round(TASK_S * rate_hz)
    handles = [recorder.start(agent, "pick") for agent in ("robot", "human")]
    began, n_before = time.process_time(), 0
    for tick in range(1, n_ticks + 1):
        now_ns[0] = BEGAN_NS + round(tick / rate_hz * 1e9)
        recorder.joints("robot", ("elbow", "wrist"), (tick % 7 / 7, 0.5))
        recorder.signal("human_speed", tick % 11 / 11)
        if tick % per_task == 0:
            for handle in handles:
                handle.end()
            handles = [recorder.start(agent, f"task {tick // per_task % 12}") for agent in ("robot", "human")]
        if tick * n_marks // n_ticks > (tick - 1) * n_marks // n_ticks:
            took_s = time.process_time() - began
            yield Mark(
                tick / rate_hz / 3600,
                2 * tick,
                memory_mb(),
                took_s / (2 * (tick - n_before)) * 1e6,
                time.process_time(),
            )
            began, n_before = time.process_time(), tick
    if close:
        recorder.close()


def memory_mb() -> float:
    """Return the memory of this process."""
    return int(_STATUS.read_text(encoding="ascii").split()[1]) * _PAGE_MB


def growth_mb(marks: list[Mark]) -> float:
    """Return by how much memory grew since the first mark."""
    return max(mark.memory_mb for mark in marks) - marks[0].memory_mb


def main() -> int:
    """Return 1 if memory grew."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--rate", type=float, default=50.0, help="samples per second of either agent")
    parser.add_argument("--close", action="store_true", help="also close the run, and tell what that takes")
    options = parser.parse_args()
    print("| hours | samples | memory MB | CPU us per sample |\n| --- | --- | --- | --- |")
    marks = []
    with tempfile.TemporaryDirectory() as folder:
        for mark in soak(Path(folder, "soak.mcap"), options.hours, options.rate, close=options.close):
            marks.append(mark)
            print(
                f"| {mark.hours:.1f} | {mark.n_samples:,} | {mark.memory_mb:.1f} | {mark.sample_us:.1f} |", flush=True
            )
    if options.close:
        peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000
        print(f"closing took {time.process_time() - marks[-1].cpu_s:.1f} s of CPU, memory {peak_mb:.0f} MB at its peak")
    grown = growth_mb(marks)
    print(f"memory grew by {grown:.1f} MB")
    return grown > MOST_GROWTH_MB


if __name__ == "__main__":
    sys.exit(main())
