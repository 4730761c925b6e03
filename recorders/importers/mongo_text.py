"""The JSON values of a MongoDB dump, in whatever layout it was exported, and what of it cannot be read.

A dump is an array, one document per line, or indented documents one behind the other, plain or compressed. Values may
be in relaxed or canonical extended JSON. A document that is cut off or broken costs itself alone.
"""

from __future__ import annotations

import gzip
import io
import json
import re
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import IO, Any, Final

from hrclog.diagnostic import Diagnostic
from hrclog.errors import ImportDataError
from hrclog.json_text import RESULT_JSON, check_depth, parse_json
from hrclog.log.limits import UNPACKED_DUMP
from hrclog.wording import counted

_EXPECTED: Final = "a JSON array of task results, or one of them after the other"
_GZIP: Final = b"\x1f\x8b"
_ZSTD: Final = b"\x28\xb5\x2f\xfd"
_MOST_BYTES: Final = 2**30  # of a dump, so that a compressed one cannot fill the memory
_PIECE: Final = 2**20
_MOST_BROKEN: Final = 1000  # rows: each is read up to its damage, which may be far

_BETWEEN: Final = re.compile(r"[\s,]*")
_NEXT_DOCUMENT: Final = re.compile(r"^[ \t,\[]*(?=\{)", re.MULTILINE)
_NUMBERS: Final[dict[str, Callable[[Any], float]]] = {
    "$numberDouble": float,
    "$numberInt": int,
    "$numberLong": int,
    "$numberDecimal": lambda text: float(Decimal(text)),
}


@dataclass(slots=True)
class DumpText:
    """The values of a dump, in order, and what could not be read."""

    values: list[Any] = field(default_factory=list)
    diagnostics: list[Diagnostic] = field(default_factory=list)


def read_dump(source: Path) -> DumpText:
    """Return the JSON values of a dump: the elements of its arrays, and what stands beside them.

    Raises:
        ImportDataError: the file cannot be opened, or no value in it can be read.
    """
    data, is_cut = _plain_bytes(source)
    text, is_cut = _decoded(source, data, is_cut=is_cut)
    try:
        value = parse_json(text, RESULT_JSON, object_hook=plain_value)
    except ValueError as error:
        found = _values_one_by_one(source, text)
        if not found.values:
            raise ImportDataError(source, f"no JSON ({error})", _EXPECTED) from error
        return found
    if not isinstance(value, dict | list):
        raise ImportDataError(source, f"a JSON {type(value).__name__}", "an array of task results")
    dump = DumpText(value if isinstance(value, list) else [value])
    if is_cut:
        dump.diagnostics.append(_cut_off(source, text, len(text), len(dump.values), ", whose compression is cut off"))
    return dump


def plain_value(value: dict[str, Any]) -> Any:  # noqa: ANN401 - a number, or the object as it is
    """Return the number that an extended-JSON object stands for, or the object where it stands for none."""
    if len(value) == 1:
        [(name, number)] = value.items()
        if name in _NUMBERS and isinstance(number, str | int | float) and not isinstance(number, bool):
            try:
                return _NUMBERS[name](number)
            except (ValueError, OverflowError, InvalidOperation):
                return value
    return value


def _values_one_by_one(source: Path, text: str) -> DumpText:
    """Read value after value; what is broken is passed over to the next line that begins with a document."""
    dump = DumpText()
    decoder = json.JSONDecoder(object_hook=plain_value)
    at, is_in_array = 0, False
    while (at := _skip(text, at)) < len(text):
        if text[at] in "[]" and is_in_array is (text[at] == "]"):
            is_in_array = not is_in_array
            at += 1
            continue
        try:
            value, at = decoder.raw_decode(text, at)
            check_depth(value)
        except (ValueError, RecursionError) as error:
            after = _NEXT_DOCUMENT.search(text, at + 1)
            if after is None or len(dump.diagnostics) >= _MOST_BROKEN:
                dump.diagnostics.append(_cut_off(source, text, at, len(dump.values), f" ({error})"))
                return dump
            problem = f"line {_line(text, at)}: found no JSON ({error}), expected a task result; it was skipped"
            dump.diagnostics.append(Diagnostic("skipped_row", problem, str(source)))
            at = after.end()
        else:
            dump.values.append(value)
    if is_in_array:
        dump.diagnostics.append(_cut_off(source, text, at, len(dump.values), " without ]"))
    return dump


def _skip(text: str, at: int) -> int:
    """Return where the next value or bracket begins."""
    match = _BETWEEN.match(text, at)
    return match.end() if match else at


def _cut_off(source: Path, text: str, at: int, n_before: int, what: str) -> Diagnostic:
    before = counted(n_before, "row before it was", "rows before it were")
    message = (
        f"line {_line(text, at)}: found a row or an array that is broken or cut off{what}, expected the whole of it; "
        f"{before} taken, and nothing after it; export it again"
    )
    return Diagnostic("truncated", message, str(source))


def _line(text: str, at: int) -> int:
    return text.count("\n", 0, at) + 1


def _decoded(source: Path, data: bytes, *, is_cut: bool) -> tuple[str, bool]:
    """Return the text of a dump, and whether its end is missing; half of a last character is left away."""
    try:
        return data.decode("utf-8-sig"), is_cut
    except UnicodeDecodeError as error:
        if error.reason == "unexpected end of data":
            return data[: error.start].decode("utf-8-sig"), True
        raise ImportDataError(source, f"no JSON ({error})", _EXPECTED) from error


def _plain_bytes(source: Path) -> tuple[bytes, bool]:
    """Return the bytes of a file without their compression, and whether the compressed data are cut off."""
    try:
        with source.open("rb") as stream:
            head = stream.read(len(_ZSTD))
            stream.seek(0)
            if head.startswith(_GZIP):
                return _unpacked(source, gzip.GzipFile(fileobj=stream))
            if head == _ZSTD:
                from zstandard import ZstdDecompressor

                return _unpacked(source, ZstdDecompressor().stream_reader(stream, read_across_frames=True))
            return stream.read(), False
    except OSError as error:
        content = f"a file that cannot be opened ({error.strerror or error})"
        raise ImportDataError(source, content, "a dump of task_results") from error


def _unpacked(source: Path, stream: io.BufferedIOBase | io.RawIOBase | IO[bytes]) -> tuple[bytes, bool]:
    from zstandard import ZstdError

    pieces, size = [], 0
    most = min(_MOST_BYTES, UNPACKED_DUMP.of(source.stat().st_size))
    try:
        while piece := stream.read(_PIECE):
            pieces.append(piece)
            size += len(piece)
            if size > most:
                content = f"more than {most:,} bytes when unpacked"
                raise ImportDataError(source, content, "a smaller dump", "unpack it, and import it in parts")
    except (EOFError, zlib.error, ZstdError, gzip.BadGzipFile):
        return b"".join(pieces), True
    return b"".join(pieces), False
