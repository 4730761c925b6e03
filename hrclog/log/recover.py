"""Turn a journal, or a damaged log, into a finished one: every message that can be read, nothing invented.

What a damaged source lost is told in the finished log, see `hrclog.log.losses`.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import chain, count
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from hrclog.errors import LogExistsError, LogReadError, LogWriteError
from hrclog.files import lock
from hrclog.log.files.annotation_files import copy_annotations
from hrclog.log.files.formats import HEAD_BYTES, Format, foreign_error, recognise
from hrclog.log.files.names import is_journal_name, plain_name
from hrclog.log.files.system import exists
from hrclog.log.files.unpack import unpacked
from hrclog.log.limits import Budget
from hrclog.log.losses import (
    NO_FOOTER,
    Loss,
    loss_of,
    of_unprotected,
    recorded_losses,
    recorded_remarks,
    remarks_on,
)
from hrclog.log.mcap.chain import is_chained
from hrclog.log.mcap.contents import Batch, Contents
from hrclog.log.mcap.records import MAGIC, PREFIX, Problem
from hrclog.log.mcap.streamed import read_streamed
from hrclog.log.messages import channels
from hrclog.log.messages.channels import EVENTS_TOPIC
from hrclog.log.messages.decode import EVENT_COLUMNS, decode_contents
from hrclog.log.messages.encode import event_message
from hrclog.log.one_log import read_log
from hrclog.log.remarks import RECOVERED
from hrclog.log.writing.journal import PARTIAL_SUFFIX
from hrclog.log.writing.writer import FinishedWriter, write_atomically
from hrclog.wording import counted

File = tuple[Contents, bytes]
"""What a file holds, and its bytes."""

_LONGEST_HEADER: Final = 1 << 12  # bytes; a longer one is damaged
_TOLD_AGAIN: Final = frozenset({"no_events", "undecodable_event", "recovered_with_losses"})


@dataclass(frozen=True, slots=True)
class Recovered:
    """The result of a recovery.

    Attributes:
        source: what was recovered.
        path: the finished log.
        n_messages: how many messages could be read.
        problems: what was lost.
        earlier: what earlier recoveries of the source lost, in words.
    """

    source: Path
    path: Path
    n_messages: int
    problems: list[Problem]
    earlier: list[str] = field(default_factory=list)


def finished_path(source: Path) -> Path:
    """Return where the finished log of a journal or a damaged log goes."""
    name = plain_name(source.name)
    if is_journal_name(name):
        return source.with_name(name.removesuffix(PARTIAL_SUFFIX))
    return source.with_name(f"{Path(name).stem}.recovered.mcap")


def recover(source: Path, path: Path | None = None, *, wait: bool = False) -> Recovered:
    """Write the finished log of a journal and remove the journal; a damaged log is kept beside its recovery.

    A journal beside a finished log of the same messages (killed between the two last steps of closing) is only removed.
    A finished log without damage is left as it is, and a compressed file is kept. Annotations go with the log.

    Args:
        source: a journal, or a damaged log.
        path: the finished log; default `finished_path`.
        wait: whether to wait until nobody else holds the source.

    Raises:
        LogReadError: the source is missing, no MCAP file, still being written, or holds no message.
        LogExistsError: the target exists and holds something else.
        LogWriteError: the finished log cannot be written, or the journal not be removed.
    """
    target = path or finished_path(source)
    with locked_bytes(source, wait=wait) as raw:
        budget = Budget(len(raw))
        data, torn = _unpacked(source, raw, budget)
        contents = read_streamed(data, budget)
        if contents.header is None and not contents.batches and not contents.attachments:
            raise _nothing_in(source, data)
        is_journal = is_journal_name(source.name)
        n_messages = sum(len(batch.start) for batch in contents.batches)
        earlier = recorded_losses(contents.metadata)
        problems = [*torn, *_losses(contents, data, is_journal=is_journal)]
        if is_journal and n_messages and not is_chained(contents, data):
            problems += _told_by_reader(source, problems)
        if not is_journal and not problems:
            return Recovered(source, source, n_messages, [], earlier)
        if not n_messages and not contents.attachments:
            kind = "journal" if is_journal else "damaged log"
            description = f"a {kind} of {counted(len(data), 'byte')} without a readable message"
            remedy = "move it away, or go on with resume=True (hrclog record --resume)" if is_journal else "keep it"
            raise LogReadError(source, description, "at least one message", f"0 events can be recovered; {remedy}")
        loss = loss_of(source, raw, problems) if problems or contents.unprotected else None
        if loss is not None and contents.unprotected:
            loss = of_unprotected(loss)
        if not exists(target) or _forgets(target, source, (contents, data), loss):
            write_atomically(target, lambda writer: _copy((contents, data), writer, loss))
        copy_annotations(source, target)
        remove_journal(source, damaged=bool(problems))
    return Recovered(source, target, n_messages, problems, earlier)


def _unpacked(source: Path, raw: bytes, budget: Budget) -> tuple[bytes, list[Problem]]:
    """Return the bytes of an MCAP file, and what of a compressed one cannot be unpacked.

    Raises:
        LogReadError: it is a log of another format, or cannot be unpacked.
    """
    file = unpacked(source, raw, recognise(raw[:HEAD_BYTES]), budget)
    if file.kind in (Format.SQLITE, Format.ROS1):
        remedy = "nothing to recover: `hrclog check` and `hrclog analyze` read it as it is, whole or damaged"
        raise LogReadError(source, f"{file.kind.value}", "a journal or another MCAP log", remedy)
    return file.data, file.problems


def _nothing_in(source: Path, data: bytes) -> LogReadError:
    """Return the error for a file of which no record can be read."""
    if data.startswith(MAGIC) or not any(data) or MAGIC.startswith(data):
        description = f"a file of {counted(len(data), 'byte')} without an MCAP header"
        remedy = "0 events can be recovered" + ("; delete it" if _ends_in_header(data) else "")
        return LogReadError(source, description, "a journal with events", remedy)
    if recognise(data[:HEAD_BYTES]) is not Format.OTHER:
        return foreign_error(source, data[:HEAD_BYTES])
    description = f"a file that begins with {data[:8]!r}"
    return LogReadError(source, description, "a journal with events", "0 events can be recovered")


def _ends_in_header(data: bytes) -> bool:
    """Return whether a file ends before or within its first record, or holds but zeros there."""
    begin = len(MAGIC) + PREFIX.size
    if not any(data[begin:]):
        return True
    opcode, length = PREFIX.unpack_from(data, len(MAGIC))
    return bool(opcode == Opcode.HEADER and len(data) - begin < length < _LONGEST_HEADER)


def _losses(contents: Contents, data: bytes, *, is_journal: bool) -> list[Problem]:
    """Return what of a file cannot be in its recovery."""
    problems = list(contents.problems)
    codes = {problem.code for problem in problems}
    if not is_journal and not contents.finished and not codes & {"truncated", "no_header"}:
        problems.append(Problem("truncated", len(data), NO_FOOTER))
    for batch in contents.batches:
        unknown = ~np.isin(batch.channel, list(contents.channels))
        if unknown.any():
            n_unknown = int(unknown.sum())
            text = counted(n_unknown, "message is", "messages are")
            offset = int(batch.start[unknown][0]) if batch.data is data else 0
            text = f"{text} on a channel that is not declared, and cannot be read"
            problems.append(Problem("corrupt_data", offset, text, n_messages=n_unknown))
    return problems


def _told_by_reader(source: Path, problems: list[Problem]) -> list[Problem]:
    """Return what reading a journal without a chain tells of losses, but for what it will tell of the recovery too."""
    known = {problem.code for problem in problems} | _TOLD_AGAIN
    try:
        diagnostics = read_log(source, signals=True).diagnostics
    except LogReadError:
        return []
    return [
        Problem(finding.code, finding.offset or 0, finding.message)
        for finding in diagnostics
        if finding.severity == "error" and finding.code not in known
    ]


@contextmanager
def locked_bytes(source: Path, *, wait: bool = False) -> Iterator[bytes]:
    """Lock a file that no other process writes, and yield its bytes.

    Args:
        source: the file.
        wait: whether to wait until nobody else holds the file.

    Raises:
        LogReadError: it cannot be opened, or somebody else holds it.
    """
    try:
        stream = source.open("rb")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise LogReadError(source, f"a file that cannot be opened ({reason})", "a journal") from error
    with stream:
        if not lock(stream.fileno(), wait=wait):
            description, expected = "a journal that a recorder still writes", "one whose recorder has ended"
            raise LogReadError(source, description, expected, "stop the recorder first")
        yield stream.read()


def remove_journal(source: Path, *, damaged: bool) -> None:
    """Remove a journal that was read in full; keep a damaged one under a name that nothing reads.

    Raises:
        LogWriteError: it cannot be removed.
    """
    if not source.name.endswith(PARTIAL_SUFFIX):
        return
    try:
        if damaged:
            source.replace(_free_name(source.with_name(source.name + ".damaged")))
        else:
            source.unlink()
    except FileNotFoundError:  # another process has recovered it too
        return
    except OSError as error:
        text = f"the finished log is written, but this journal cannot be removed ({error.strerror})"
        raise LogWriteError(source, text, "remove it") from error


def _free_name(path: Path) -> Path:
    """Return a path, or the first of those with a number behind it that is free."""
    numbered = (path.with_name(f"{path.name}.{number}") for number in count(2))
    return next(candidate for candidate in chain([path], numbered) if not os.path.lexists(candidate))


def _forgets(target: Path, source: Path, file: File, loss: Loss | None) -> bool:
    """Return whether a recovered log of the same messages does not tell of the loss, or lacks attachments.

    Raises:
        LogReadError: the target cannot be opened.
        LogExistsError: it holds other messages.
    """
    try:
        written = target.read_bytes() if target.is_file() else b""
    except OSError as error:
        raise LogReadError(
            target, f"a file that cannot be opened ({error.strerror})", "no file, or the same log"
        ) from error
    contents, existing = file[0], read_streamed(written)
    here, there = Counter(_messages(contents)), Counter(_messages(existing))
    remarks = there - here
    if here - there or not all(topic == EVENTS_TOPIC and RECOVERED.encode() in data for topic, _, data in remarks):
        raise LogExistsError(target, f"it differs from {source}; choose another name with -o")
    is_silent = loss is not None and not recorded_remarks(existing.metadata)
    return is_silent or bool(_attachments(*file) - _attachments(existing, written))


def _attachments(contents: Contents, data: bytes) -> Counter[tuple[str, bytes]]:
    return Counter((attachment.name, data[attachment.start : attachment.end]) for attachment in contents.attachments)


def _messages(contents: Contents) -> Iterator[tuple[str, int, bytes]]:
    for batch in contents.batches:
        for channel_id, log_time, _, _, start, end in _rows(batch):
            channel = contents.channels.get(channel_id)
            if channel is not None:
                yield channel.topic, log_time, batch.data[start:end]


def _rows(batch: Batch) -> Iterator[tuple[int, int, int, int, int, int]]:
    arrays = (batch.channel, batch.log_time, batch.publish_time, batch.sequence, batch.start, batch.end)
    return zip(*(array.tolist() for array in arrays), strict=True)


def _copy(file: File, writer: FinishedWriter, loss: Loss | None) -> None:
    """Copy all that can be read, messages of the event topic first, so that a reader of events can skip the others."""
    contents, data = file
    ids = _register(contents, writer)
    for is_events in (True, False):
        for batch in contents.batches:
            for channel, log_time, publish_time, sequence, start, end in _rows(batch):
                if channel in ids and (contents.channels[channel].topic == EVENTS_TOPIC) is is_events:
                    writer.add_raw(ids[channel], log_time, publish_time, sequence, batch.data[start:end])
        if loss is not None and is_events:
            _add_remarks(contents, writer, loss)
    for attachment in contents.attachments:
        writer.attachment(attachment, data[attachment.start : attachment.end])
    for metadata in contents.metadata:
        writer.metadata(metadata.name, metadata.metadata)
    if loss is not None:
        writer.metadata(RECOVERED, loss)


def _add_remarks(contents: Contents, writer: FinishedWriter, loss: Loss) -> None:
    """Tell each run of the loss."""
    decoded = decode_contents(contents, lambda *_: None, signals=False)
    events = pl.concat([EVENT_COLUMNS.to_frame(), *decoded.events])
    for remark in remarks_on(loss, events):
        writer.add(event_message(remark, remark.time_ns))


def _register(contents: Contents, writer: FinishedWriter) -> dict[int, int]:
    """Declare the channels in the new file; return its ids by the old ones."""
    ids: dict[int, int] = {}
    taken: set[object] = set()
    for old, channel in contents.channels.items():
        schema = contents.schemas.get(channel.schema_id)
        schema_id = writer.schema(schema.name, schema.encoding, schema.data) if schema else 0
        # under our own key, so that remarks go on the channel that is there
        key = channels.EVENTS if _is_event_channel(channel, schema) and channels.EVENTS not in taken else old
        taken.add(key)
        ids[old] = writer.channel(key, channel.topic, channel.message_encoding, schema_id, channel.metadata)
    return ids


def _is_event_channel(channel: Channel, schema: Schema | None) -> bool:
    """Return whether a channel is as hrclog declares its event channel."""
    ours = channels.EVENTS
    return (
        schema is not None
        and (schema.name, schema.encoding, schema.data) == (ours.type_name, channels.SCHEMA_ENCODING, ours.definition)
        and (channel.topic, channel.message_encoding, channel.metadata)
        == (ours.topic, channels.CDR, dict(ours.metadata))
    )
