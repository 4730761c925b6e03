"""A table of 100,000 executions into logs: in columns, and event by event through the writer."""

from __future__ import annotations

import random
import tempfile
from pathlib import Path

from measure import child_cpu_seconds, cpu_seconds, table

from hrclog.events import Event
from hrclog.log.writing.writer import write_log
from hrclog.recorders.importers.table.importer import TableImporter
from hrclog.recorders.importers.writing import import_files

ROWS = 100_000
RUNS = (10, 1_000, 4_000)


def write_table(path: Path, runs: int) -> None:
    """Write a table of `ROWS` executions in as many runs."""
    numbers = random.Random(1)  # noqa: S311 - a benchmark
    with path.open("w", encoding="utf-8") as stream:
        stream.write("run,agent,task,start,end,outcome\n")
        for row in range(ROWS):
            run, agent = row % runs, ("robot", "human")[row // runs % 2]
            start = 1_772_442_000 + run * 1000.0 + row // runs * 5 + numbers.random()
            end = start + 5 * numbers.random()
            stream.write(f"run_{run},{agent},task_{row // runs % 12},{start:.6f},{end:.6f},succeeded\n")


def one_by_one(source: Path, folder: Path) -> None:
    """Write the logs of a table event by event."""
    foreign = TableImporter().read([source])
    folder.mkdir()
    for number, run in enumerate(foreign.names):
        events: list[Event] = list(foreign.events(run))
        write_log(folder / f"{number}.mcap", events)


def command(source: Path, folder: Path) -> None:
    """Import a table by the command line."""
    import subprocess
    import sys

    line = [sys.executable, "-m", "hrclog", "import", "table", str(source), "-o", str(folder)]
    subprocess.run(line, check=True, capture_output=True)


def main() -> None:
    """Print the tables."""
    for runs in RUNS:
        with tempfile.TemporaryDirectory() as name:
            folder, source = Path(name), Path(name) / "table.csv"
            write_table(source, runs)
            costs = [
                ("in columns", cpu_seconds(lambda: import_files(TableImporter(), [source], folder / "a"), 1)),  # noqa: B023 - called at once, within its round
                ("the same again", cpu_seconds(lambda: import_files(TableImporter(), [source], folder / "a"), 1)),  # noqa: B023 - called at once, within its round
                ("hrclog import table", child_cpu_seconds(lambda: command(source, folder / "b"), 1)),  # noqa: B023 - called at once, within its round
                ("event by event", cpu_seconds(lambda: one_by_one(source, folder / "c"), 1)),  # noqa: B023 - called at once, within its round
            ]
        print(table(costs, f"100,000 rows of CSV, {runs:,} runs", ROWS), end="\n\n")


if __name__ == "__main__":
    main()
