"""Undo the compression of whole files and of single messages, within bounds: a few KB may stand for gigabytes."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import zstandard

from hrclog.errors import LogReadError
from hrclog.log.files.formats import HEAD_BYTES, Format, recognise
from hrclog.log.files.mapped import map_file
from hrclog.log.limits import WHOLE_FILE, Budget, LimitError
from hrclog.log.mcap.records import Problem
from hrclog.wording import counted

_PIECE: Final = 1 << 10  # bytes of input at a time: of zstd they unpack to 32 MiB at most
_LAYERS: Final = 2

_Stream = Any  # a decompression object of zlib or zstandard: `decompress`, `eof` and `unused_data`
_STREAMS: Final[dict[Format, Callable[[], _Stream]]] = {
    Format.GZIP: lambda: zlib.decompressobj(zlib.MAX_WBITS | 16),
    Format.ZSTD: lambda: zstandard.ZstdDecompressor().decompressobj(),
}
_DAMAGE: Final = (zlib.error, zstandard.ZstdError, MemoryError)


@dataclass(frozen=True, slots=True)
class Unpacked:
    """What came out, how many bytes of the input are in it, and what is wrong with the rest."""

    data: bytes
    n_read: int
    trouble: str = ""


@dataclass(frozen=True, slots=True)
class Loaded:
    """A file's kind and bytes, unpacked, and what could not be; `data` is empty where SQLite reads the file itself.

    `budget` is that of the file as it lies on the disk.
    """

    kind: Format
    data: bytes
    problems: list[Problem]
    budget: Budget


def unpack(data: bytes, kind: Format, limit: int) -> Unpacked:
    """Unpack one frame of zstd or gzip after the other, as far as they are whole.

    Raises:
        LimitError: more than `limit` bytes come out.
    """
    frames: list[bytes] = []
    n_bytes, position = 0, 0
    while position < len(data):
        if position and recognise(data[position : position + HEAD_BYTES]) is not kind:
            is_filled = not any(data[position:])  # some tools fill up with zeros
            return Unpacked(b"".join(frames), position, "" if is_filled else "what follows is no frame")
        frame = _frame(data, kind, position, limit - n_bytes)
        frames.append(frame.data)
        n_bytes += len(frame.data)
        position = frame.n_read
        if frame.trouble:
            return Unpacked(b"".join(frames), position, frame.trouble)
    return Unpacked(b"".join(frames), position)


def _frame(data: bytes, kind: Format, begin: int, limit: int) -> Unpacked:
    """Unpack the frame at `begin`; `n_read` counts from the start of the data."""
    pieces: list[bytes] = []
    n_bytes, position, stream = 0, begin, _STREAMS[kind]()
    while not stream.eof:
        if position >= len(data):
            return Unpacked(b"".join(pieces), len(data), "its end is missing")
        try:
            piece = stream.decompress(data[position : position + _PIECE])
        except _DAMAGE as error:
            piece, position = _before_damage(data, kind, begin, position)
            return Unpacked(b"".join([*pieces, piece]), position, str(error))
        n_bytes += len(piece)
        if n_bytes > limit:
            raise LimitError(WHOLE_FILE, n_bytes, limit)
        pieces.append(piece)
        position = min(position + _PIECE, len(data))
    return Unpacked(b"".join(pieces), position - len(stream.unused_data))


def _before_damage(data: bytes, kind: Format, begin: int, piece_at: int) -> tuple[bytes, int]:
    """Return what a damaged piece of a frame gives up to the damage, and where that is."""
    stream = _STREAMS[kind]()
    for at in range(begin, piece_at, _PIECE):
        stream.decompress(data[at : at + _PIECE])
    content: list[bytes] = []
    for at in range(piece_at, len(data)):
        try:
            content.append(stream.decompress(data[at : at + 1]))
        except _DAMAGE:
            return b"".join(content), at
    return b"".join(content), len(data)


def load(path: Path, *, mapped: bool = False) -> Loaded:
    """Read a file and undo its compression.

    Args:
        path: the file.
        mapped: whether to map it into memory, for large files of which little is wanted.

    Raises:
        LogReadError: it cannot be opened, unpacks to too much, was compressed more than twice, or holds nothing that
            can be unpacked.
    """
    try:
        with path.open("rb", buffering=0) as stream:
            kind = recognise(stream.read(HEAD_BYTES))
            stream.seek(0)
            data = b"" if mapped or kind is Format.SQLITE else stream.read()
        if mapped and kind is not Format.SQLITE:
            data = map_file(path)
        budget = Budget(len(data) or path.stat().st_size)
    except OSError as error:
        raise LogReadError(path, f"a file that cannot be opened ({error.strerror})", "an event log") from error
    return unpacked(path, data, kind, budget)


def unpacked(path: Path, data: bytes, kind: Format, budget: Budget) -> Loaded:
    """Undo the compression of a file that was read.

    Args:
        path: the file.
        data: its bytes.
        kind: its format.
        budget: of the file.

    Raises:
        LogReadError: it unpacks to too much, was compressed more than twice, or holds nothing that can be unpacked.
    """
    problems: list[Problem] = []
    for _ in range(_LAYERS):
        if kind in _STREAMS:
            data, layer_problems = _unpack_file(path, data, kind, budget.left(WHOLE_FILE))
            budget.spend(WHOLE_FILE, len(data))
            problems += layer_problems
            kind = recognise(data[:HEAD_BYTES])
    if kind in _STREAMS:
        raise LogReadError(path, f"a file compressed more than {_LAYERS} times", "a log", "unpack it first")
    return Loaded(kind, data, problems, budget)


def _unpack_file(path: Path, data: bytes, kind: Format, limit: int) -> tuple[bytes, list[Problem]]:
    try:
        content = unpack(data, kind, limit)
    except LimitError as error:
        what = f"{counted(len(data), 'byte')} that unpack to more than {counted(limit, 'byte')}"
        raise LogReadError(path, what, f"a log ({error})", "unpack it yourself if it really is one") from error
    if not content.trouble:
        return content.data, []
    if not content.data:
        raise LogReadError(path, f"{kind.value} that cannot be unpacked ({content.trouble})", "a whole file")
    n_left = len(data) - content.n_read
    left = f"; its last {counted(n_left, 'byte')} could not be unpacked" if n_left else ""
    text = f"the compressed file is damaged ({content.trouble}){left}"
    return content.data, [Problem("truncated", content.n_read, text)]
