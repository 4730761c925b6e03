"""Make broken_off.mcap: a run with a plan that stopped on the way, for `hrclog plan --from` to plan the rest of.

Its recorder lost power, and the journal was closed afterwards: what was under way has no end.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import hrclog
from hrclog.events import RunStarted
from hrclog.log.writing.writer import write_log
from hrclog.sim.run import simulate_run

SEED = 4
BROKEN_OFF_S = 40


def main(path: Path) -> int:
    """Write the log."""
    events = simulate_run(hrclog.load_scenario("paper"), SEED, 0).events
    last_ns = events[0].time_ns + BROKEN_OFF_S * 10**9
    kept = (event for event in events if event.time_ns <= last_ns)
    write_log(path, (replace(event, name=path.stem) if isinstance(event, RunStarted) else event for event in kept))
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
