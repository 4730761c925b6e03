"""`hrclog record`: runs from any program, as JSON lines on standard input."""

from __future__ import annotations

import io
import os
import signal
import sys
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Final, Self

import click

from hrclog.cli.common import EXIT_DATA_LOST, EXIT_FAILED, EXIT_FINE, echo, json_option, print_json
from hrclog.cli.on_run_end import Following, on_run_end_option
from hrclog.cli.tag_option import tag_option
from hrclog.json_text import EVENT_JSON
from hrclog.wording import counted

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from hrclog.events import Event
    from hrclog.recorders.line_run import Recorded
    from hrclog.recorders.sample_lines import Sample
    from hrclog.recorders.stdin import Hooks, Recording, Refused


MAX_CHARACTERS: Final = EVENT_JSON.n_bytes
"""Longest line; of a longer one the end is not read, and so it is refused."""


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
            return "" if self.stopped else _line()
        except _Stop:
            return ""
        finally:
            self._waiting = False

    def _stop(self, number: int, frame: FrameType | None) -> None:
        self.stopped = True
        if self._waiting:  # elsewhere an event is being written, which must not be interrupted
            raise _Stop


def _line() -> str:
    """Return the next line of standard input; of one that is too long only its beginning, so that memory suffices."""
    line = rest = sys.stdin.readline(MAX_CHARACTERS)
    while len(rest) == MAX_CHARACTERS and not rest.endswith("\n"):
        rest = sys.stdin.readline(MAX_CHARACTERS)
        line = f"{line[:MAX_CHARACTERS]}…"
    return line


@click.command(name="record")
@click.argument("path", metavar="OUT.mcap", type=click.Path(path_type=Path))
@click.option("--run", default="", help="Name of the run.  [default: the file's name]")
@click.option("--resume", is_flag=True, help="Continue the run at OUT.mcap in a further segment.")
@click.option("--fsync", is_flag=True, help="Each event also survives a crash of the operating system.")
@click.option("--ack", is_flag=True, help="Print seq and execution_id of each event once it is safe.")
@tag_option
@on_run_end_option
@json_option
def command(
    path: Path,
    run: str,
    resume: bool,
    fsync: bool,
    ack: bool,
    tags: dict[str, str],
    knowledge: str | None,
    as_json: bool,
) -> int:
    """Record a run from JSON lines on standard input, until it closes.

    Each line is one event: `kind`, `agent`, `task`, and what else docs/events.md names; or a sample, of kind signal,
    joints, pose, scene or description: docs/recording.md. `time_ns` defaults to now; a first line of kind run_started
    may name the run, and give its tags; a task_ended without `execution_id` ends the open execution of that agent and
    task. A further run_started begins another run, in a log of its own: OUT-run2.mcap, OUT-run3.mcap and so on; so does
    a new `run` or `run_id` in any line, and runs that lines name so may go on side by side. A line that cannot be
    recorded is reported with its number, and the rest goes on (exit code 3).

    \b
    Example:
      echo '{"kind": "task_started", "agent": "robot", "task": "pick"}' | hrclog record run.mcap
    """
    from hrclog.recorders.recorder import log_path
    from hrclog.recorders.stdin import record_stream

    with _Input() as lines, Following(knowledge) as following:
        tale = _Tale(log_path(path), following, ack=ack)
        result = record_stream(
            lines,
            path,
            run=run,
            resume=resume,
            fsync=fsync,
            tags=tags,
            hooks=tale.hooks(lambda: "canceled" if lines.stopped else "succeeded"),
        )
        if as_json:
            print_json(_as_json(result))
        elif result.refused:
            _say(f"{counted(len(result.refused), 'line')} refused")
        code = following.catch_up(" ".join(map(str, tale.logs)))
    return max(code, tale.code, EXIT_DATA_LOST if result.refused or result.losses else EXIT_FINE)


def _say(text: str) -> None:
    """Print a line on standard error; that nobody reads it any more must not end the recording."""
    with suppress(OSError):
        echo(text, err=True)


class _Tale:
    """Tells what becomes of the lines, and lets a knowledge base follow the runs.

    Args:
        path: the log of the first run, whose earlier segments may lie beside it.
        following: the knowledge base.
        ack: acknowledge each line on standard output.
    """

    def __init__(self, path: Path, following: Following, *, ack: bool) -> None:
        self.logs: list[Path] = []
        self.code = EXIT_FINE
        self._path = path
        self._following = following
        self._ack = ack

    def hooks(self, outcome: Callable[[], str]) -> Hooks:
        """Return what is called while lines are recorded; `outcome` is asked for that of a run that nothing ended."""
        from hrclog.recorders.stdin import Hooks

        return Hooks(self.event, self.sample, self.refusal, self.run, self.loss, outcome)

    def event(self, event: Event) -> None:
        """Acknowledge an event."""
        self._acknowledge({"seq": event.seq, "execution_id": getattr(event, "execution_id", "")})

    def sample(self, sample: Sample) -> None:
        """Acknowledge a sample."""
        from hrclog.recorders.sample_lines import SAMPLE_KINDS

        self._acknowledge({SAMPLE_KINDS[sample.kind].plural: list(sample.names)})

    def refusal(self, refused: Refused) -> None:
        """Say why a line was refused."""
        _say(f"error: line {refused.line}: {refused.reason}")
        self._acknowledge({"line": refused.line, "error": refused.reason})

    def loss(self, text: str) -> None:
        """Say what was lost of the run before it was resumed."""
        _say(f"error: {text}")

    def run(self, recorded: Recorded) -> None:
        """Say where a finished run is, and let the knowledge base take it in."""
        samples = f", {counted(recorded.n_samples, 'sample')}" if recorded.n_samples else ""
        _say(f"{recorded.path}: {counted(recorded.n_events, 'event')}{samples} recorded")
        for remark in recorded.remarks:
            _say(f"warning: {recorded.path}: {remark}")
        segments = _segments(recorded.path if recorded.number > 1 else self._path)
        self.logs += segments
        self._following.take(segments)

    def _acknowledge(self, reply: dict[str, object]) -> None:
        if not self._ack:
            return
        try:
            print_json(reply, indent=None)
        except OSError as error:  # whoever read them has gone, or the disk is full; recording goes on
            self._ack = False
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # for what is left in the buffer
            reason = error.strerror or str(error)
            _say(f"warning: lines are acknowledged no more, for standard output cannot be written ({reason})")
            self.code = EXIT_FINE if isinstance(error, BrokenPipeError) else EXIT_FAILED


def _segments(path: Path) -> list[Path]:
    """Return all segments of the run at a path, in order."""
    from hrclog.recorders.segments import segments

    return [segment for segment in segments(path) if segment.exists()]


def _as_json(result: Recording) -> dict[str, object]:
    """Return what was recorded as JSON values; path and id are those of the first run."""
    first = result.runs[0]
    return {
        "path": str(first.path),
        "run_id": first.run_id,
        "n_events": sum(run.n_events for run in result.runs),
        "n_samples": sum(run.n_samples for run in result.runs),
        "n_refused": len(result.refused),
        "losses": list(result.losses),
        "runs": [asdict(run) | {"path": str(run.path)} for run in result.runs],
    }
