"""Turn a journal, or a damaged log, into a finished one: every message that can be read, nothing invented."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from hrclog.errors import LogExistsError, LogReadError
from hrclog.log.records import MAGIC, Batch, Contents, Problem, read_streamed
from hrclog.log.writer import PARTIAL_SUFFIX, FinishedWriter, fcntl, write_atomically


@dataclass(frozen=True, slots=True)
class Recovered:
    """What became of a journal."""

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

    Raises:
        LogReadError: the source is missing, no MCAP file, still being written, or holds no header.
        LogExistsError: the target exists and holds something else.
    """
    target = path or finished_path(source)
    with _locked(source) as data:
        if not data.startswith(MAGIC):
            raise LogReadError(source, f"a file of {len(data)} bytes without an MCAP header", "a journal with events",
                               "0 events can be recovered; delete it")
        contents = read_streamed(data)
        n_messages = sum(len(batch.start) for batch in contents.batches)
        if target.exists():
            _check_same(target, source, contents)
        else:
            write_atomically(target, lambda writer: _copy(contents, writer))
        if source.name.endswith(PARTIAL_SUFFIX) and not contents.problems:
            source.unlink()
        elif source.name.endswith(PARTIAL_SUFFIX):
            source.replace(source.with_name(source.name + ".damaged"))
    return Recovered(source, target, n_messages, contents.problems)


@contextmanager
def _locked(source: Path) -> Iterator[bytes]:
    try:
        with source.open("rb") as stream:
            if fcntl is not None:
                try:
                    fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError as error:
                    found = "a journal that a recorder still writes"
                    raise LogReadError(source, found, "one whose recorder has ended", "stop the recorder first") from error
            yield stream.read()
    except OSError as error:
        raise LogReadError(source, f"a file that cannot be opened ({error.strerror})", "a journal") from error


def _check_same(target: Path, source: Path, contents: Contents) -> None:
    existing = read_streamed(target.read_bytes())
    if sorted(_messages(existing)) != sorted(_messages(contents)):
        raise LogExistsError(target, f"it differs from {source}; choose another name with -o")


def _messages(contents: Contents) -> Iterator[tuple[str, int, bytes]]:
    for batch in contents.batches:
        for channel, log_time, _, _, start, end in _rows(batch):
            if channel in contents.channels:
                yield contents.channels[channel].topic, log_time, bytes(batch.data[start:end])


def _rows(batch: Batch) -> Iterator[tuple[int, int, int, int, int, int]]:
    arrays = (batch.channel, batch.log_time, batch.publish_time, batch.sequence, batch.start, batch.end)
    return zip(*(array.tolist() for array in arrays), strict=True)


def _copy(contents: Contents, writer: FinishedWriter) -> None:
    """Copy all messages, those of the event topic first, so that a reader of events can skip the other chunks."""
    ids: dict[int, int] = {}
    for channel_id, channel in contents.channels.items():
        schema = contents.schemas.get(channel.schema_id)
        schema_id = writer.schema(schema.name, schema.encoding, schema.data) if schema else 0
        ids[channel_id] = writer.channel(channel_id, channel.topic, channel.message_encoding, schema_id, channel.metadata)
    for is_events in (True, False):
        for batch in contents.batches:
            for channel, log_time, publish_time, sequence, start, end in _rows(batch):
                if channel in ids and (contents.channels[channel].topic == "/hrc/events") is is_events:
                    writer.add_raw(ids[channel], log_time, publish_time, sequence, bytes(batch.data[start:end]))
    for metadata in contents.metadata:
        with suppress(ValueError):
            writer.metadata(metadata.name, metadata.metadata)
