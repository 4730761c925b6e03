"""Journals without a message, cut before the first or destroyed: a run that goes on moves them out of the way."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mcap.opcode import Opcode

from hrclog.log.losses import Loss, loss_of
from hrclog.log.mcap.records import MAGIC, PREFIX
from hrclog.log.mcap.streamed import read_streamed
from hrclog.log.messages.channels import PROFILE
from hrclog.log.recover import locked_bytes, remove_journal

_CHUNK_HEAD: Final = struct.Struct("<BQQQQIIQ")
_HEADER_BEGIN: Final = struct.pack("<I", len(PROFILE)) + PROFILE.encode()
_LONGEST_HEADER: Final = 1 << 10  # bytes


@dataclass(frozen=True, slots=True)
class Cleared:
    """A journal without a message that is out of the way.

    Attributes:
        loss: what was lost in it, None where nothing was: its recorder had acknowledged no event.
    """

    loss: Loss | None = None


def clear(journal: Path) -> Cleared | None:
    """Move a journal out of the way that holds no message; None if it holds one, and stays.

    One that was cut before its first message is removed; any other is kept as NAME.damaged.

    Raises:
        LogReadError: it cannot be opened, or a recorder still writes it.
        LogWriteError: it cannot be removed.
    """
    with locked_bytes(journal) as data:
        contents = read_streamed(data)
        if contents.batches:
            return None
        loss = None if is_begun(data) else loss_of(journal, data, contents.problems)
        remove_journal(journal, damaged=loss is not None)
    return Cleared(loss)


def is_begun(data: bytes) -> bool:
    """Return whether bytes are the beginning of a journal, and end before its first message does."""
    if not data.startswith(MAGIC):
        return MAGIC.startswith(data)
    contents = read_streamed(data)
    if contents.batches or {problem.code for problem in contents.problems} - {"truncated", "no_header"}:
        return False
    torn_at = min((problem.offset for problem in contents.problems), default=len(data))
    return _is_cut(data[torn_at:])


def _is_cut(rest: bytes) -> bool:
    """Return whether bytes can be the beginning of a header, or of a chunk, whose end was not written."""
    if len(rest) < PREFIX.size:
        return not rest or rest[0] in (Opcode.HEADER, Opcode.CHUNK)
    opcode, length = PREFIX.unpack_from(rest)
    if PREFIX.size + length <= len(rest):
        return False
    if opcode == Opcode.HEADER:
        return bool(length < _LONGEST_HEADER) and _agree(rest[PREFIX.size :], _HEADER_BEGIN)
    if opcode != Opcode.CHUNK or len(rest) < _CHUNK_HEAD.size:
        return bool(opcode == Opcode.CHUNK)
    _, _, begin, end, size, _, compression, n_bytes = _CHUNK_HEAD.unpack_from(rest)
    is_ours = begin == end and compression == 0 and size == n_bytes == length - (_CHUNK_HEAD.size - PREFIX.size)
    return bool(is_ours) and _begins_with_a_record(rest[_CHUNK_HEAD.size :], size)


def _begins_with_a_record(body: bytes, size: int) -> bool:
    """Return whether the first bytes of a chunk of a size are those of a declaration or of a message."""
    if len(body) < PREFIX.size:
        return not body or body[0] in (Opcode.SCHEMA, Opcode.MESSAGE)
    opcode, length = PREFIX.unpack_from(body)
    return opcode in (Opcode.SCHEMA, Opcode.MESSAGE) and bool(PREFIX.size + length <= size)


def _agree(some: bytes, other: bytes) -> bool:
    """Return whether one of two texts begins with the other."""
    return some.startswith(other[: len(some)]) and other.startswith(some[: len(other)])
