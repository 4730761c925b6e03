"""What a knowledge base costs: taking runs in and updating statistics, in SQLite, PostgreSQL, and beside a plain file.

PostgreSQL is measured where its server is installed; the peer appends the rows of each run to one JSON-lines file.
"""

from __future__ import annotations

import json
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

import polars as pl

sys.path.append(str(Path(__file__).parents[1] / "tests" / "helpers"))
from kb_postgres import binaries, private_server

from hrclog.analyzers.learning.ingest import frame_of_events, ingest, ingest_events, ingest_logs, update_statistics
from hrclog.analyzers.projections.intervals import rebuild
from hrclog.events import Event
from hrclog.knowledge import open_knowledge
from hrclog.log.writing.writer import write_log
from hrclog.sim.run import simulate_run
from hrclog.sim.scenario import load_scenario

MANY, SOME, REPEATS = 1000, 50, 20


def milliseconds(*functions: Callable[[], object]) -> float:
    """Return how long the median call takes."""
    taken: list[float] = []
    for function in functions:
        since = time.perf_counter()
        function()
        taken.append((time.perf_counter() - since) * 1e3)
    return statistics.median(taken)


def appended(path: Path, events: pl.DataFrame) -> None:
    """Append the executions of each run to a file."""
    rows = rebuild(events)[0].partition_by("run_id")
    with path.open("a", encoding="utf-8") as stream:
        for run in rows:
            stream.writelines(json.dumps(row) + "\n" for row in run.to_dicts())
            stream.flush()


def measure(where: str, logs: list[Path], runs: list[list[Event]], frames: dict[int, pl.DataFrame]) -> Iterator[float]:
    """Yield the milliseconds of each row of the table."""
    with open_knowledge(f"{where}", create=True) as kb:
        ingest(kb, frames[1])  # connections and caches
        yield milliseconds(*(partial(ingest_events, kb, run) for run in runs))
        yield milliseconds(*(partial(ingest_logs, kb, [log]) for log in logs))
        ingest(kb, frames[SOME])
        update_statistics(kb, "paper")
        yield milliseconds(lambda: update_statistics(kb, "aft"))
        yield milliseconds(lambda: ingest(kb, frames[MANY]))
        yield milliseconds(lambda: ingest(kb, frames[MANY]))
        yield milliseconds(lambda: update_statistics(kb, "aft"))
        yield milliseconds(*[partial(update_statistics, kb, "aft")] * REPEATS)
        yield milliseconds(*[kb.times] * REPEATS)


@contextmanager
def places(folder: Path) -> Iterator[dict[str, str]]:
    """Give the places to measure."""
    found = {"SQLite": str(folder / "kb.sqlite")}
    with ExitStack() as stack:
        programs = binaries()
        if programs:
            found["PostgreSQL"] = stack.enter_context(private_server(programs, "-c fsync=on")).new_schema()
        yield found


def main() -> None:
    """Print a table of milliseconds."""
    scenario = load_scenario("paper")
    runs = [simulate_run(scenario, 1, index).events for index in range(MANY + 2 * REPEATS)]
    frame = {n: frame_of_events([event for run in runs[:n] for event in run]) for n in (1, SOME, MANY)}
    what = [
        "a run of 24 executions from memory",
        "a run from its log",
        f"update (aft), {SOME} runs",
        f"{MANY} runs, one transaction each",
        f"the same {MANY} runs again",
        f"update (aft), {MANY} runs",
        "update with nothing to do",
        "times for a planner",
    ]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        logs = [folder / f"{number}.mcap" for number in range(REPEATS)]
        for log, events in zip(logs, runs[MANY:], strict=False):
            write_log(log, events)
        further = list(map(list, runs[MANY + REPEATS :]))
        with places(folder) as found:
            columns = {place: list(measure(where, logs, further, frame)) for place, where in found.items()}
        append = partial(appended, folder / "rows")
        peer = [0.0] * len(what)
        peer[0] = milliseconds(*(partial(append, frame_of_events(run)) for run in further))
        peer[3] = milliseconds(partial(append, frame[MANY]))
    print(f"| ms | {' | '.join(columns)} | append to a file |")
    print("| --- " * (len(columns) + 2) + "|")
    for number, text in enumerate(what):
        cells = [f"{column[number]:,.1f}" for column in columns.values()]
        print(f"| {text} | {' | '.join(cells)} | {f'{peer[number]:,.1f}' if peer[number] else ''} |")
    print(f"\n{os.cpu_count()} cores; wall-clock time, the median of {REPEATS} calls where one is short")


if __name__ == "__main__":
    main()
