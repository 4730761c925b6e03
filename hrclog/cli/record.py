"""`hrclog record`: events from any program, as JSON lines on standard input."""

from __future__ import annotations

import io
import json
import signal
import sys
from itertools import count, takewhile
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Self

import click

from hrclog.cli.common import EXIT_DATA_LOST, EXIT_FINE, json_option, print_json, printable
from hrclog.cli.on_run_end import Following, on_run_end_option
from hrclog.wording import counted

if TYPE_CHECKING:
    from collections.abc import Iterator

    from hrclog.events import Event


class _Stop(Exception):  # noqa: N818 - a request, not an error
    """A signal asked to stop."""


class _Input:
    """The lines of standard input until it closes or SIGTERM or SIGINT asks to stop; no line is cut in two."""

    def __init__(self) -> None:
        self._waiting = False
        self.stopped = False
        if isinstance(sys.stdin, io.TextIOWrapper):
            sys.stdin.reconfigure(errors="backslashreplace")  # bytes that are no text make one bad line, not the last

    def __enter__(self) -> Self:
        self._before = {number: signal.signal(number, self._stop) for number in (signal.SIGTERM, signal.SIGINT)}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def __iter__(self) -> Iterator[str]:
        while line := self._next():
            yield line

    def _next(self) -> str:
        try:
            self._waiting = True
            return "" if self.stopped else sys.stdin.readline()
        except _Stop:
            return ""
        finally:
            self._waiting = False

    def _stop(self, number: int, frame: FrameType | None) -> None:
        self.stopped = True
        if self._waiting:  # elsewhere an event is being written, which must not be interrupted
            raise _Stop


@click.command(name="record")
@click.argument("path", metavar="OUT.mcap", type=click.Path(path_type=Path))
@click.option("--run", default="", help="Name of the run.  [default: the file's name]")
@click.option("--resume", is_flag=True, help="Continue the run at OUT.mcap in a further segment.")
@click.option("--fsync", is_flag=True, help="Each event also survives a crash of the operating system.")
@click.option("--ack", is_flag=True, help="Print seq and execution_id of each event once it is safe.")
@on_run_end_option
@json_option
def command(
    path: Path,
    run: str,
    resume: bool,
    fsync: bool,
    ack: bool,
    knowledge: str | None,
    as_json: bool,
) -> int:
    """Record a run from JSON lines on standard input, until it closes.

    Each line is one event: `kind`, `agent`, `task`, and what else docs/events.md names. `time_ns` defaults to now;
    a first line of kind run_started may name the run; a task_ended without `execution_id` ends the open execution of
    that agent and task. A line that cannot be recorded is reported with its number, and the rest goes on (exit code 3).

    \b
    Example:
      echo '{"kind": "task_started", "agent": "robot", "task": "pick"}' | hrclog record run.mcap
    """
    from hrclog.recorders.stdin import Refused, record_stream

    def accepted(event: Event) -> None:
        if ack:
            _acknowledge({"seq": event.seq, "execution_id": getattr(event, "execution_id", "")})

    def refuse(line: Refused) -> None:
        click.echo(printable(f"error: line {line.line}: {line.reason}"), err=True)
        if ack:
            _acknowledge({"line": line.line, "error": line.reason})

    with _Input() as lines:
        result = record_stream(
            lines,
            path,
            run=run,
            resume=resume,
            fsync=fsync,
            on_event=accepted,
            on_refusal=refuse,
            outcome=lambda: "canceled" if lines.stopped else "succeeded",
        )
    n_refused = len(result.refused)
    if as_json:
        print_json(
            {
                "path": str(result.path),
                "run_id": result.run_id,
                "n_events": result.n_events,
                "n_refused": n_refused,
            }
        )
    else:
        recorded, refused = counted(result.n_events, "event"), counted(n_refused, "line")
        click.echo(f"{result.path}: {recorded} recorded, {refused} refused", err=True)
    return max(_follow(knowledge, path), EXIT_DATA_LOST if n_refused else EXIT_FINE)


def _follow(knowledge: str | None, path: Path) -> int:
    """Add all segments of the run to a knowledge base and return the exit code."""
    from hrclog.recorders.recorder import log_path
    from hrclog.recorders.segments import segment_path

    paths = list(takewhile(Path.exists, (segment_path(log_path(path), number) for number in count(1))))
    with Following(knowledge) as following:
        following.take(paths)
        return following.catch_up(" ".join(map(str, paths)))


def _acknowledge(reply: dict[str, object]) -> None:
    click.echo(json.dumps(reply))
    sys.stdout.flush()
