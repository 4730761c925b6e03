"""Damaged MCAP files: bytes changed, records removed, doubled, swapped or inserted, other files' tails appended."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from random import Random
from typing import Final

MAGIC: Final = b"\x89MCAP0\r\n"

_PREFIX: Final = struct.Struct("<BQ")
_CHUNK_HEAD: Final = struct.Struct("<QQQII")
_CHUNK, _MESSAGE, _MESSAGE_INDEX = 6, 5, 7


@dataclass(frozen=True, slots=True)
class Base:
    """A whole file that is damaged, and another of the same kind whose parts get into it."""

    name: str
    data: bytes
    other: bytes
    protected: bool
    """Whether checksums cover the messages."""

    @property
    def is_journal(self) -> bool:
        """Return whether the file is one that a recorder still writes."""
        return self.name.startswith("journal")

    @property
    def suffix(self) -> str:
        """Return the ending of its name."""
        return ".mcap.partial" if self.is_journal else ".mcap"

    def is_earlier_end(self, mutant: bytes) -> bool:
        """Return whether a mutant is the journal as it was when an earlier record had just been written."""
        ends = {end for _, end in records(self.data)} | {len(MAGIC)}
        return self.is_journal and len(mutant) in ends and self.data.startswith(mutant)


Span = tuple[int, int]
Mutate = Callable[[Base, Random], bytes | None]


def records(data: bytes) -> list[Span]:
    """Return where the records of a whole file lie, chunks not expanded."""
    spans: list[Span] = []
    at = len(MAGIC)
    while at + _PREFIX.size <= len(data) and data[at : at + len(MAGIC)] != MAGIC:
        end = at + _PREFIX.size + _PREFIX.unpack_from(data, at)[1]
        spans.append((at, end))
        at = end
    return spans


def _replaced(data: bytes, span: Span, by: bytes) -> bytes:
    return data[: span[0]] + by + data[span[1] :]


def _range(data: bytes, chance: Random, longest: int) -> Span:
    size = chance.randrange(1, longest + 1)
    begin = chance.randrange(max(len(data) - size, 1))
    return begin, begin + size


# bytes


def _flip_bit(base: Base, chance: Random) -> bytes:
    at = chance.randrange(len(base.data))
    return _replaced(base.data, (at, at + 1), bytes([base.data[at] ^ 1 << chance.randrange(8)]))


def _change_bytes(base: Base, chance: Random) -> bytes:
    begin, end = _range(base.data, chance, 8)
    return _replaced(base.data, (begin, end), chance.randbytes(end - begin))


def _zero_bytes(base: Base, chance: Random) -> bytes:
    begin, end = _range(base.data, chance, chance.choice((8, 64, 512)))
    return _replaced(base.data, (begin, end), bytes(end - begin))


def _zero_head(base: Base, chance: Random) -> bytes:
    """Zero the first bytes of a record's content: times, sizes, checksum."""
    begin, end = chance.choice(records(base.data))
    size = min(chance.choice((8, 20, 40)), end - begin - _PREFIX.size)
    return _replaced(base.data, (begin + _PREFIX.size, begin + _PREFIX.size + size), bytes(size))


def _extreme_number(base: Base, chance: Random) -> bytes:
    """Set eight bytes of a record to a number near a limit."""
    begin, end = chance.choice([span for span in records(base.data) if span[1] - span[0] >= 24])
    at = chance.randrange(begin + 1, end - 8)
    number = chance.choice((0, 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1))
    return _replaced(base.data, (at, at + 8), number.to_bytes(8, "little"))


def _cut(base: Base, chance: Random) -> bytes:
    return base.data[: chance.randrange(len(base.data))]


def _cut_at_record(base: Base, chance: Random) -> bytes:
    return base.data[: chance.choice(records(base.data))[0]]


def _delete_bytes(base: Base, chance: Random) -> bytes:
    return _replaced(base.data, _range(base.data, chance, chance.choice((1, 16, 600))), b"")


def _insert_bytes(base: Base, chance: Random) -> bytes:
    at = chance.randrange(len(base.data))
    return _replaced(base.data, (at, at), chance.randbytes(chance.choice((1, 8, 300))))


def _append_bytes(base: Base, chance: Random) -> bytes:
    size = chance.choice((1, 9, 4096))
    return base.data + chance.choice((bytes(size), chance.randbytes(size), b"\xff" * size))


# whole records, as they lie in the file: indexes behind them no longer fit


def _remove_record(base: Base, chance: Random) -> bytes:
    return _replaced(base.data, chance.choice(records(base.data)), b"")


def _remove_records(base: Base, chance: Random) -> bytes:
    spans = records(base.data)
    first = chance.randrange(len(spans))
    last = min(first + chance.randrange(1, 12), len(spans)) - 1
    return _replaced(base.data, (spans[first][0], spans[last][1]), b"")


def _remove_chunk(base: Base, chance: Random) -> bytes | None:
    """Remove a chunk together with the message indexes that follow it."""
    spans = records(base.data)
    chunks = [i for i, (begin, _) in enumerate(spans) if base.data[begin] == _CHUNK]
    if not chunks:
        return None
    first = last = chance.choice(chunks)
    while last + 1 < len(spans) and base.data[spans[last + 1][0]] == _MESSAGE_INDEX:
        last += 1
    return _replaced(base.data, (spans[first][0], spans[last][1]), b"")


def _double_record(base: Base, chance: Random) -> bytes:
    begin, end = chance.choice(records(base.data))
    return _replaced(base.data, (end, end), base.data[begin:end])


def _repeat_record(base: Base, chance: Random) -> bytes:
    """Copy a record to another place."""
    spans = records(base.data)
    begin, end = chance.choice(spans)
    at = chance.choice(spans)[1]
    return _replaced(base.data, (at, at), base.data[begin:end])


def _swap_records(base: Base, chance: Random) -> bytes:
    (a, b), (c, d) = sorted(chance.sample(records(base.data), 2))
    data = base.data
    return data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:]


def _insert_foreign(base: Base, chance: Random) -> bytes:
    """Insert a record of the other file."""
    begin, end = chance.choice(records(base.other))
    at = chance.choice(records(base.data))[1]
    return _replaced(base.data, (at, at), base.other[begin:end])


def _replace_by_foreign(base: Base, chance: Random) -> bytes:
    """Put a record of the other file in place of one of the same kind."""
    span = chance.choice(records(base.data))
    same = [other for other in records(base.other) if base.other[other[0]] == base.data[span[0]]]
    begin, end = chance.choice(same or records(base.other))
    return _replaced(base.data, span, base.other[begin:end])


# tails of other files


def _append_file(base: Base, chance: Random) -> bytes:
    return base.data + chance.choice((base.other, base.data))


def _append_tail(base: Base, chance: Random) -> bytes:
    """Append the end of the other file, from one of its records on."""
    return base.data + base.other[chance.choice(records(base.other))[0] :]


def _splice_tail(base: Base, chance: Random) -> bytes:
    """Let the file go on as the other one, from one record to another."""
    head = base.data[: chance.choice(records(base.data))[1]]
    return head + base.other[chance.choice(records(base.other))[0] :]


def _overwrite_tail(base: Base, chance: Random) -> bytes | None:
    """Leave the other file's bytes behind a place, as a disk does that lost its last blocks."""
    at = chance.randrange(len(base.data)) // 512 * 512
    mixed = base.data[:at] + base.other[at:]
    return None if mixed == base.other else mixed  # files begin alike, and the other file is whole


# messages inside a chunk, its sizes and checksum made to fit


def _inside(change: Callable[[list[bytes], Random], list[bytes]]) -> Mutate:
    def mutate(base: Base, chance: Random) -> bytes | None:
        chunks = [span for span in records(base.data) if base.data[span[0]] == _CHUNK and _plain_body(base.data, span)]
        if not chunks:
            return None
        span = chance.choice(chunks)
        inner = _plain_body(base.data, span)
        parts = [inner[begin:end] for begin, end in _inner_records(inner)]
        messages = [part for part in parts if part[0] == _MESSAGE]
        if not messages:
            return None
        others = [part for part in parts if part[0] != _MESSAGE]
        return _replaced(base.data, span, _chunk_like(base.data, span, b"".join(others + change(messages, chance))))

    return mutate


def _plain_body(data: bytes, span: Span) -> bytes:
    """Return the records of an uncompressed chunk, b"" where it is compressed."""
    at = span[0] + _PREFIX.size
    name_size = _CHUNK_HEAD.unpack_from(data, at)[4]
    return b"" if name_size else data[at + _CHUNK_HEAD.size + 8 : span[1]]


def _inner_records(inner: bytes) -> list[Span]:
    spans: list[Span] = []
    at = 0
    while at < len(inner):
        end = at + _PREFIX.size + _PREFIX.unpack_from(inner, at)[1]
        spans.append((at, end))
        at = end
    return spans


def _chunk_like(data: bytes, span: Span, inner: bytes) -> bytes:
    start, end, _, crc, _ = _CHUNK_HEAD.unpack_from(data, span[0] + _PREFIX.size)
    head = _CHUNK_HEAD.pack(start, end, len(inner), zlib.crc32(inner) if crc else 0, 0)
    content = head + len(inner).to_bytes(8, "little") + inner
    return _PREFIX.pack(_CHUNK, len(content)) + content


def _without_one(messages: list[bytes], chance: Random) -> list[bytes]:
    at = chance.randrange(len(messages))
    return messages[:at] + messages[at + 1 :]


def _with_one_twice(messages: list[bytes], chance: Random) -> list[bytes]:
    at = chance.randrange(len(messages))
    return [*messages[: at + 1], *messages[at:]]


BYTES: Final[Mapping[str, Mutate]] = {
    "bit flipped": _flip_bit,
    "bytes changed": _change_bytes,
    "bytes zeroed": _zero_bytes,
    "head of a record zeroed": _zero_head,
    "extreme number": _extreme_number,
    "cut": _cut,
    "bytes deleted": _delete_bytes,
    "bytes inserted": _insert_bytes,
    "bytes appended": _append_bytes,
}
RECORDS: Final[Mapping[str, Mutate]] = {
    "cut at a record": _cut_at_record,
    "record removed": _remove_record,
    "records removed": _remove_records,
    "chunk and its indexes removed": _remove_chunk,
    "record doubled": _double_record,
    "record repeated elsewhere": _repeat_record,
    "records swapped": _swap_records,
    "foreign record inserted": _insert_foreign,
    "record replaced by a foreign one": _replace_by_foreign,
}
TAILS: Final[Mapping[str, Mutate]] = {
    "whole file appended": _append_file,
    "tail of another file appended": _append_tail,
    "goes on as another file": _splice_tail,
    "blocks of another file at the end": _overwrite_tail,
}
INSIDE: Final[Mapping[str, Mutate]] = {
    "message removed inside a chunk": _inside(_without_one),
    "message doubled inside a chunk": _inside(_with_one_twice),
}
FAMILIES: Final[Mapping[str, Mapping[str, Mutate]]] = {
    "bytes": BYTES,
    "records": RECORDS,
    "tails": TAILS,
    "inside chunks": INSIDE,
}
"""Kinds of damage by family; those inside chunks need somebody who writes right checksums."""
KINDS: Final[list[tuple[str, str]]] = [(family, kind) for family, kinds in FAMILIES.items() for kind in kinds]


def mutant(base: Base, family: str, kind: str, chance: Random) -> bytes | None:
    """Return a damaged file; None where the base has nothing of that kind, or nothing has changed."""
    damaged = FAMILIES[family][kind](base, chance)
    return None if damaged == base.data else damaged
