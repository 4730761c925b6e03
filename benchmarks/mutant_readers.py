"""What readers make of a damaged file: ours and, beside it on the same file, mcap's and rosbags'."""

from __future__ import annotations

import io
import re
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any, Final

from mcap.exceptions import McapError
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader, ReaderError

from hrclog.analyzers.projections.intervals import rebuild
from hrclog.cli import main
from hrclog.errors import HrclogError
from hrclog.log.reader import read_logs
from hrclog.log.recover import recover

_STOP_AFTER_S: Final = 60
_STATUS: Final = Path("/proc/self/status")
_CLEAR: Final = Path("/proc/self/clear_refs")


class TooLong(BaseException):
    """A reader took so long that it was stopped."""


@dataclass(slots=True)
class Reading:
    """What a reader made of a file: how it ended, which facts it gave, what it cost."""

    code: int = 0
    """0 all is there, 1 refused, 3 lost data."""
    facts: Any = None
    codes: list[str] = field(default_factory=list)
    untyped: str = ""
    cpu_s: float = 0.0
    peak_mb: float = 0.0


def read_ours(path: Path) -> Reading:
    """Read events and signals with hrclog; the facts are frames."""

    def read(reading: Reading) -> None:
        logs = read_logs(path, signals=True)
        findings = [*logs.diagnostics, *rebuild(logs.events)[1]]
        reading.codes = sorted({finding.code for finding in findings})
        reading.code = 3 if any(finding.severity == "error" for finding in findings) else 0
        reading.facts = logs.events.drop("path"), logs.signals.sort(logs.signals.columns)

    return _measured(read, HrclogError)


def read_our_events(path: Path) -> Reading:
    """Read events only."""

    def read(reading: Reading) -> None:
        logs = read_logs(path)
        findings = [*logs.diagnostics, *rebuild(logs.events)[1]]
        reading.code = 3 if any(finding.severity == "error" for finding in findings) else 0
        reading.facts = (logs.events.drop("path"),)

    return _measured(read, HrclogError)


def check_ours(path: Path) -> int:
    """Return the exit code of `hrclog check`, -1 for an untyped error."""
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        try:
            return main(["check", str(path)])
        except Exception:  # noqa: BLE001 - whatever it is, it is not what the command should end with
            return -1


def recover_ours(path: Path, target: Path) -> Reading:
    """Recover a file and read what came of it; code 1 where nothing did."""

    def run(reading: Reading) -> None:
        done = recover(path, target)
        found = read_ours(done.path)
        reading.code, reading.facts, reading.codes, reading.untyped = (
            found.code,
            found.facts,
            found.codes,
            found.untyped,
        )

    return _measured(run, HrclogError)


def read_mcap(path: Path) -> Reading:
    """Read all messages with mcap's own reader, checksums on."""

    def read(reading: Reading) -> None:
        with path.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            reading.facts = sorted(
                (channel.topic, message.log_time, message.sequence, message.data)
                for _, channel, message in reader.iter_messages()
            )

    return _measured(read, McapError)


def read_rosbags(path: Path) -> Reading:
    """Read all messages with rosbags."""

    def read(reading: Reading) -> None:
        bag = Reader(path)
        bag.open()
        try:
            reading.facts = sorted(
                (connection.topic, time_ns, bytes(raw)) for connection, time_ns, raw in bag.messages()
            )
        finally:
            bag.close()

    return _measured(read, ReaderError)


PEERS: Final[dict[str, Callable[[Path], Reading]]] = {"mcap": read_mcap, "rosbags": read_rosbags}


def same_facts(first: Any, second: Any) -> bool:  # noqa: ANN401 - frames of ours, lists of peers
    """Return whether two readings gave the same facts."""
    if isinstance(first, tuple) and isinstance(second, tuple):
        return all(one.equals(other) for one, other in zip(first, second, strict=True))
    return bool(first == second)


def _measured(read: Callable[[Reading], None], typed: type[Exception]) -> Reading:
    """Return what a reader gave, its CPU time, and the memory of the process at its peak meanwhile."""
    reading = Reading()
    with suppress(OSError):
        _CLEAR.write_text("5")  # forgets the peak so far
    began = time.process_time()
    try:
        with _limited():
            read(reading)
    except typed:
        reading.code = 1
    except TooLong:
        reading.code, reading.cpu_s = 1, float(_STOP_AFTER_S)
    except Exception as error:  # noqa: BLE001 - what is counted here is whatever is raised
        reading.code, reading.untyped = 1, re.sub(r"\d+", "N", f"{type(error).__name__}: {error}")[:120]
    reading.cpu_s = max(reading.cpu_s, time.process_time() - began)
    reading.peak_mb = _peak_mb()
    return reading


@contextmanager
def _limited() -> Iterator[None]:
    def stop(_number: int, _frame: FrameType | None) -> None:
        raise TooLong

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(_STOP_AFTER_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def _peak_mb() -> float:
    match = re.search(r"VmHWM:\s+(\d+) kB", _STATUS.read_text()) if _STATUS.exists() else None
    return int(match[1]) / 1000 if match else 0.0
