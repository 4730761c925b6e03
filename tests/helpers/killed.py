"""Processes that are killed at any moment, and what must hold of what they leave.

A server process imports all and forks a child per job, so that a kill does not wait for imports. Run as a script it is
that server.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Final, Self

import polars as pl

from hrclog.diagnostic import CODES
from hrclog.errors import LogReadError
from hrclog.log.logs import Logs
from hrclog.log.reader import read_logs
from hrclog.log.recover import recover
from hrclog.log.writing.journal import journal_path
from hrclog.recorders.recorder import Recorder

ACKNOWLEDGED: Final = "acknowledged"
UNFINISHED: Final = {"truncated", "no_header", "no_events"}
"""Errors of a journal whose recorder was killed: bytes are torn, or nothing is there."""
REMEMBERED: Final = "recovered_with_losses"
REMARK: Final = "annotation_added"
"""How a log remembers the torn bytes of the journal that it was recovered from: an error, and an event."""

PATIENCE_S: Final = 60.0
"""How long a job may take to its first acknowledgements."""

Acknowledge = Callable[[str, str], object]


def _acknowledge(folder: Path) -> Acknowledge:
    """Return what appends a kind and an execution to the folder's list of acknowledged events."""
    fd = os.open(folder / ACKNOWLEDGED, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    return lambda kind, execution_id: os.write(fd, f"{kind} {execution_id}\n".encode())


def record(folder: Path, pace_s: float, count: int, *, signals: bool = False, resume: bool = False) -> None:
    """Record tasks, and close the run after the last."""
    acknowledge = _acknowledge(folder)
    recorder = Recorder(folder / "run.mcap", agents=["robot"], resume=resume)
    for i in range(count):
        handle = recorder.start("robot", f"task {i % 7}", details={"text": "x" * (i % 5 * 1000)})
        acknowledge("task_started", handle.execution_id)
        time.sleep(pace_s)
        if signals:
            for sample in range(10):
                recorder.signal("distance", sample)
                recorder.joints("robot", ["elbow"], [sample / 10])
        handle.end()
        acknowledge("task_ended", handle.execution_id)
        recorder.signal("distance", i)
    recorder.close()
    acknowledge("run_ended", "")


def close(folder: Path) -> None:
    """Close the journal that a killed recorder left."""
    recover(journal_path(folder / "run.mcap"))


def pipe(folder: Path) -> None:
    """Record the lines of a file with `hrclog record`, which acknowledges into another."""
    from hrclog.cli import main

    os.dup2(os.open(folder / "lines.jsonl", os.O_RDONLY), 0)
    os.dup2(os.open(folder / "acknowledged.jsonl", os.O_WRONLY | os.O_CREAT), 1)
    sys.stdin, sys.stdout = os.fdopen(0, encoding="utf-8"), os.fdopen(1, "w", encoding="utf-8")
    main(["record", str(folder / "run.mcap"), "--ack"])


def simulate(folder: Path, seed: int) -> None:
    """Simulate a campaign."""
    from hrclog.cli import main

    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    os.dup2(1, 2)
    main(["sim", "--scenario", "paper", "--runs", "30", "--seed", str(seed), "-o", str(folder / "sim")])


def learn(folder: Path, step: int) -> None:
    """Take runs into a knowledge base, a few at a time, and acknowledge how many."""
    from kb_runs import frame_of_runs

    from hrclog.analyzers.learning.ingest import ingest, update_statistics
    from hrclog.knowledge import open_knowledge

    acknowledge = _acknowledge(folder)
    with open_knowledge(str(folder / "kb.sqlite"), create=True, wait_s=60.0) as kb:
        for first in range(0, 100, step):
            ingest(kb, frame_of_runs(range(first, first + step)))
            acknowledge("runs", str(first + step))
            update_statistics(kb, "paper")


JOBS: Final[Mapping[str, Callable[..., None]]] = {job.__name__: job for job in (record, close, pipe, simulate, learn)}

PRELOADED: Final = ("hrclog.cli.record", "hrclog.cli.sim", "hrclog.recorders.stdin", "hrclog.sim.campaign", "kb_work")


def serve() -> None:
    """Fork a child per line: the job's name, its folder and its arguments, as JSON."""
    for module in PRELOADED:
        import_module(module)
    for line in sys.stdin:
        name, folder, arguments = json.loads(line)
        child = os.fork()
        if not child:
            try:
                JOBS[name](Path(folder), **arguments)
            finally:  # a recorder that was killed early may have left nothing to close or to resume
                os._exit(0)
        print(child, flush=True)  # noqa: T201 - the answer
        sys.stdin.readline()  # until then a child that has ended keeps its number
        os.waitpid(child, 0)
        print("reaped", flush=True)  # noqa: T201 - the answer


class Server:
    """The server process."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def run_and_kill(self, job: str, folder: Path, after_s: float, *, n_first: int = 0, **arguments: object) -> None:
        """Let a process do a job, and kill it some time after its first acknowledgements, however slow the machine."""
        child = int(self._ask(json.dumps([job, str(folder), arguments])))
        until = time.monotonic() + PATIENCE_S
        while len(acknowledged(folder)) < n_first and time.monotonic() < until:
            time.sleep(0.001)
        time.sleep(after_s)
        os.kill(child, signal.SIGKILL)
        answer = self._ask("reap")
        if answer != "reaped\n":
            raise RuntimeError(f"the server answered {answer!r}")

    def _ask(self, line: str) -> str:
        if self._process.stdin is None or self._process.stdout is None:
            raise RuntimeError("the server has no streams")
        self._process.stdin.write(f"{line}\n")
        self._process.stdin.flush()
        answer: str = self._process.stdout.readline()
        return answer

    def close(self) -> None:
        """Let the process end."""
        self._process.communicate()


@dataclass(slots=True)
class Left:
    """What a kill left: in which state, how much was acknowledged, how much of that is lost, and what else is wrong."""

    state: str
    n_acknowledged: int = 0
    n_lost: int = 0
    faults: list[str] = field(default_factory=list)

    def expect(self, holds: object, fault: str) -> None:
        """Note a fault unless something holds."""
        if not holds:
            self.faults.append(fault)


def acknowledged(folder: Path) -> list[tuple[str, str]]:
    """Return the acknowledged events, (kind, execution)."""
    path = folder / ACKNOWLEDGED
    # the kill may tear this file's last line too
    lines = path.read_text().split("\n")[:-1] if path.exists() else []
    return [(kind, execution_id) for kind, _, execution_id in (line.partition(" ") for line in lines)]


def acknowledged_lines(folder: Path) -> list[tuple[str, str]]:
    """Return the events that `hrclog record --ack` acknowledged, the kinds taken from the lines of its input."""
    path = folder / "acknowledged.jsonl"
    replies = [json.loads(line) for line in path.read_text().split("\n")[:-1]] if path.exists() else []
    kinds = [json.loads(line)["kind"] for line in (folder / "lines.jsonl").read_text().splitlines()]
    return [(kind, reply["execution_id"]) for kind, reply in zip(kinds[1:], replies, strict=False)]


def check_run(folder: Path, events: list[tuple[str, str]]) -> Left:
    """Check what a killed recorder left of a run, before and after its journals are closed."""
    logs = sorted(path for pattern in ("run*.mcap", "run*.mcap.partial") for path in folder.glob(pattern))
    left = Left("+".join(path.name for path in logs) or "nothing", len(events))
    if not logs:
        left.n_lost = len(events)
        return left
    try:
        before = read_logs(logs)
        _check_events(left, before, events)
        errors = _check_errors(left, before, logs)
        for journal in folder.glob("run*.mcap.partial"):
            _close(left, journal, before)
        if left.state.endswith("no header"):
            return left
        after = read_logs([*folder.glob("run*.mcap")])
        left.expect(_same_events(before, after), "recovery changed the events")
        codes = {finding.code for finding in after.diagnostics if finding.severity == "error"} - {"no_events"}
        left.expect(errors or not codes, f"the recovered log has {sorted(codes)}")
        if REMEMBERED in CODES:
            torn = bool(errors & {"truncated", REMEMBERED})
            left.expect((REMEMBERED in codes) is torn, f"torn bytes: {torn}, the recovered log has {sorted(codes)}")
    except Exception as error:  # noqa: BLE001 - whatever it is, what was left cannot be read
        left.n_lost = left.n_lost or left.n_acknowledged
        left.faults.append(f"unreadable: {type(error).__name__}: {error}")
    return left


def _close(left: Left, journal: Path, before: Logs) -> None:
    try:
        recover(journal)
    except LogReadError:
        left.expect(before.events.is_empty(), "a journal with events cannot be closed")
        left.state += ", no header"


def _check_events(left: Left, logs: Logs, events: list[tuple[str, str]]) -> None:
    """Check that a log holds what was acknowledged, in that order, and at most one event more per recorder."""
    rows = logs.events.sort("seq").select("kind", "execution_id").rows()
    n_recorders = sum(kind == "run_started" for kind, _ in rows)
    recorded = [row for row in rows if row[0] not in ("run_started", REMARK)]
    left.n_lost = len(set(events) - set(recorded))
    rest = iter(recorded)
    left.expect(all(event in rest for event in events), "events are not in the order of their acknowledgement")
    n_more = len(recorded) - len(events)
    left.expect(n_more <= max(n_recorders, 1), f"{n_more} events were not acknowledged")
    left.expect(logs.events["seq"].sort().to_list() == list(range(logs.events.height)), "seq has gaps")


def _check_errors(left: Left, logs: Logs, paths: list[Path]) -> set[str]:
    """Check that errors are told only where bytes are torn or nothing is there; return them."""
    errors = {finding.code for finding in logs.diagnostics if finding.severity == "error"}
    left.expect(errors <= {*UNFINISHED, REMEMBERED}, f"errors {sorted(errors - UNFINISHED)}")
    journals = [path for path in paths if path.suffix == ".partial"]
    left.expect(errors <= {REMEMBERED} or journals or logs.events.is_empty(), "a finished log has errors")
    return errors


def _same_events(before: Logs, after: Logs) -> bool:
    """Return whether a recovery kept all events and added none but its remark."""
    first, second = (logs.events.drop("path").filter(pl.col("kind") != REMARK) for logs in (before, after))
    return first.equals(second)


if __name__ == "__main__":
    serve()
