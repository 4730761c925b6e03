"""100,000 JSON lines of each kind through `hrclog record`, beside parsing them only."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from measure import child_cpu_seconds, cpu_seconds, table

LINES = 100_000
NOON = 1_772_452_800_000_000_000
JOINTS = {f"joint_{number}": 0.1 * number for number in range(6)}


def _line(kind: str, number: int) -> dict[str, Any]:
    """Return the fields of a line."""
    if kind == "events":
        what = {"kind": ("task_started", "task_ended")[number % 2], "agent": ("robot", "human")[number // 2 % 2]}
        return what | {"task": f"task {number // 2 % 12}"}
    fields: dict[str, dict[str, Any]] = {
        "signals": {"kind": "signal", "name": "distance", "value": number * 0.1},
        "signals, runs in turn": {"kind": "signal", "name": "distance", "value": 0.1, "run": f"run {number % 10}"},
        "joints": {"kind": "joints", "agent": "robot", "values": JOINTS},
        "poses": {"kind": "pose", "name": "cube", "position": [number * 0.01, 0.0, 1.0]},
    }
    return fields[kind]


def _texts(kind: str) -> Iterator[str]:
    for number in range(LINES):
        yield json.dumps(_line(kind, number) | {"time_ns": NOON + number * 10**6})


def _record(source: Path, folder: str) -> None:
    with source.open() as lines, tempfile.TemporaryDirectory(dir=folder) as place:
        command = [sys.executable, "-m", "hrclog", "record", f"{place}/run.mcap"]
        subprocess.run(command, stdin=lines, check=True, capture_output=True)


def _parse(source: Path) -> None:
    with source.open() as lines:
        for line in lines:
            json.loads(line)


def main() -> None:
    """Print the table."""
    costs: list[tuple[str, float]] = []
    with tempfile.TemporaryDirectory() as folder:
        for kind in ("events", "signals", "signals, runs in turn", "joints", "poses"):
            source = Path(folder) / "lines.jsonl"
            source.write_text("\n".join(_texts(kind)))
            costs.append((kind, child_cpu_seconds(lambda: _record(source, folder), 2)))  # noqa: B023 - called at once
        costs.append(("parsing of the last only", cpu_seconds(lambda: _parse(source), 2)))
    print(table(costs, f"{LINES:,} lines", LINES))


if __name__ == "__main__":
    main()
