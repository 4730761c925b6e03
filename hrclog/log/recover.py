"""Turn a journal, or a damaged log, into a finished one: every message that can be read, nothing invented."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from hrclog.errors import LogExistsError, LogReadError, LogWriteError
from hrclog.log.channels import EVENTS_TOPIC
from hrclog.log.contents import Batch, Contents
from hrclog.log.files import exists, lock
from hrclog.log.journal import PARTIAL_SUFFIX
from hrclog.log.records import Problem
from hrclog.log.streamed import read_streamed
from hrclog.log.writer import FinishedWriter, write_atomically
from hrclog.wording import counted


@dataclass(frozen=True, slots=True)
class Recovered:
    """The result of a recovery."""

    source: Path
    path: Path
    n_messages: int
    problems: list[Problem]


def finished_path(source: Path) -> Path:
    """Return where the finished log of a journal or a damaged log goes."""
    if source.name.endswith(PARTIAL_SUFFIX):
        return source.with_name(source.name.removesuffix(PARTIAL_SUFFIX))
    return source.with_name(f"{source.stem}.recovered.mcap")


def recover(source: Path, path: Path | None = None) -> Recovered:
    """Write the finished log of a journal and remove the journal; a damaged log is kept beside its recovery.

    A journal beside a finished log of the same messages (killed between the two last steps of closing) is only removed.
    A finished log without damage is left as it is.

    Raises:
        LogReadError: the source is missing, no MCAP file, still being written, or holds nothing.
        LogExistsError: the target exists and holds something else.
        LogWriteError: the finished log cannot be written, or the journal not be removed.
    """
    target = path or finished_path(source)
    with _read_locked(source) as data:
        contents = read_streamed(data)
        if contents.header is None and not contents.batches:
            description = f"a file of {counted(len(data), 'byte')} without an MCAP header"
            raise LogReadError(source, description, "a journal with events", "0 events can be recovered; delete it")
        is_journal = source.name.endswith(PARTIAL_SUFFIX)
        n_messages = sum(len(batch.start) for batch in contents.batches)
        if not is_journal and not contents.problems and contents.finished:
            return Recovered(source, source, n_messages, [])
        if not is_journal and not n_messages:
            description = f"a damaged log of {counted(len(data), 'byte')} without a readable message"
            raise LogReadError(source, description, "at least one message", "nothing can be recovered from it")
        if exists(target):
            _check_same(target, source, contents)
        else:
            write_atomically(target, lambda writer: _copy(contents, writer))
        _remove_journal(source, damaged=bool(contents.problems))
    return Recovered(source, target, n_messages, contents.problems)


@contextmanager
def _read_locked(source: Path) -> Iterator[bytes]:
    """Lock a file that no other process writes, and yield its bytes."""
    try:
        stream = source.open("rb")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise LogReadError(source, f"a file that cannot be opened ({reason})", "a journal") from error
    with stream:
        if not lock(stream.fileno(), wait=False):
            description, expected = "a journal that a recorder still writes", "one whose recorder has ended"
            raise LogReadError(source, description, expected, "stop the recorder first")
        yield stream.read()


def _remove_journal(source: Path, *, damaged: bool) -> None:
    """Remove a journal that was read in full; keep a damaged one under a name that nothing reads."""
    if not source.name.endswith(PARTIAL_SUFFIX):
        return
    try:
        if damaged:
            source.replace(source.with_name(source.name + ".damaged"))
        else:
            source.unlink()
    except OSError as error:
        text = f"the finished log is written, but this journal cannot be removed ({error.strerror})"
        raise LogWriteError(source, text, "remove it") from error


def _check_same(target: Path, source: Path, contents: Contents) -> None:
    try:
        existing = read_streamed(target.read_bytes() if target.is_file() else b"")
    except OSError as error:
        raise LogReadError(
            target, f"a file that cannot be opened ({error.strerror})", "no file, or the same log"
        ) from error
    if sorted(_messages(existing)) != sorted(_messages(contents)):
        raise LogExistsError(target, f"it differs from {source}; choose another name with -o")


def _messages(contents: Contents) -> Iterator[tuple[str, int, bytes]]:
    for batch in contents.batches:
        for channel_id, log_time, _, _, start, end in _rows(batch):
            channel = contents.channels.get(channel_id)
            if channel is not None:
                yield channel.topic, log_time, batch.data[start:end]


def _rows(batch: Batch) -> Iterator[tuple[int, int, int, int, int, int]]:
    arrays = (batch.channel, batch.log_time, batch.publish_time, batch.sequence, batch.start, batch.end)
    return zip(*(array.tolist() for array in arrays), strict=True)


def _copy(contents: Contents, writer: FinishedWriter) -> None:
    """Copy all messages, those of the event topic first, so that a reader of events can skip the other chunks."""
    ids = _register(contents, writer)
    for is_events in (True, False):
        for batch in contents.batches:
            for channel, log_time, publish_time, sequence, start, end in _rows(batch):
                if channel in ids and (contents.channels[channel].topic == EVENTS_TOPIC) is is_events:
                    writer.add_raw(ids[channel], log_time, publish_time, sequence, batch.data[start:end])
    for metadata in contents.metadata:
        writer.metadata(metadata.name, metadata.metadata)


def _register(contents: Contents, writer: FinishedWriter) -> dict[int, int]:
    """Declare the channels in the new file; return its ids by the old ones."""
    ids: dict[int, int] = {}
    for old, channel in contents.channels.items():
        schema = contents.schemas.get(channel.schema_id)
        schema_id = writer.schema(schema.name, schema.encoding, schema.data) if schema else 0
        ids[old] = writer.channel(old, channel.topic, channel.message_encoding, schema_id, channel.metadata)
    return ids
