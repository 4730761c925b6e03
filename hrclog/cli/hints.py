"""Say of files that are no logs which command imports them, ready to be typed."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from hrclog.errors import HrclogError, LogReadError

if TYPE_CHECKING:
    from hrclog.diagnostic import Diagnostic

_MOST_FILES: Final = 200  # of a folder that are looked at
_FOREIGN: Final = ("no_events", "not_imported")
_FAILED: Final = "unreadable_file"


def with_hint(error: HrclogError) -> str:
    """Return the text of an error, with the command that imports the file where it is not a log."""
    cause = error.__cause__ if isinstance(error.__cause__, LogReadError) else error
    if not isinstance(cause, LogReadError):
        return str(error)
    return _joined(str(error), import_line(cause.path, logs_too=False))


def hinted(findings: Iterable[Diagnostic]) -> list[Diagnostic]:
    """Return findings, those of files that are no logs of hrclog with the command that imports them."""
    return [
        replace(finding, message=_joined(finding.message, _line_for(finding)))
        if finding.path and finding.code in (*_FOREIGN, _FAILED)
        else finding
        for finding in findings
    ]


def import_line(path: Path, *, logs_too: bool) -> str:
    """Return the command that imports a file, or the first file of a folder that can be imported; "" if none can.

    Args:
        path: of the file, bag or folder.
        logs_too: whether it may be a file that hrclog reads as it is: a bag.
    """
    from hrclog.log.files.formats import HEAD_BYTES, Format, recognise
    from hrclog.recorders.importers.heads import without_compression

    for file in _files_at(path, logs_too=logs_too):
        head = _head(file)
        kind = recognise(without_compression(head)[:HEAD_BYTES])
        if not head or (kind in (Format.MCAP, Format.SQLITE, Format.ROS1, Format.RERUN) and not logs_too):
            continue
        line = _line(path if logs_too else file, head)
        if line:
            return line
    return ""


def shell_quoted(text: str) -> str:
    """Return a text as a shell takes it for one word; a name that begins with - is no option then."""
    text = f"./{text}" if text.startswith("-") else text
    if text.isprintable():
        return shlex.quote(text)
    plain = (
        chr(byte) if 0x20 <= byte < 0x7F and byte not in b"\\'" else f"\\x{byte:02x}" for byte in os.fsencode(text)
    )
    return f"$'{''.join(plain)}'"


def _line_for(finding: Diagnostic) -> str:
    from hrclog.log.reader import tells_of_another_system

    if finding.code in _FOREIGN:
        return import_line(Path(finding.path), logs_too=True) if tells_of_another_system(finding) else ""
    return import_line(Path(finding.path), logs_too=False)


def _line(path: Path, head: bytes) -> str:
    from hrclog.recorders.importers.importers import IMPORTERS

    for name in IMPORTERS.names():
        with suppress(HrclogError):  # an importer of another package that cannot be loaded
            arguments = IMPORTERS[name].arguments_for(head, path.name)
            if arguments is not None:
                return " ".join(["hrclog import", name, shell_quoted(str(path)), *([arguments] if arguments else [])])
    return ""


def _joined(text: str, line: str) -> str:
    return f"{text}; import it with `{line}`" if line and line not in text else text


def _files_at(path: Path, *, logs_too: bool) -> list[Path]:
    """Return the file itself, the parts of a bag, or the first files right in a folder."""
    from hrclog.log.bags.folder import open_bag

    try:
        if not path.is_dir():
            return [path] if path.is_file() else []
        if logs_too:
            return open_bag(path).parts
        with os.scandir(path) as entries:
            return sorted(path / entry.name for entry in entries if entry.is_file())[:_MOST_FILES]
    except (OSError, ValueError, LogReadError):
        return []


def _head(path: Path) -> bytes:
    from hrclog.recorders.importers.heads import HEAD_BYTES

    try:
        with path.open("rb") as stream:
            return stream.read(HEAD_BYTES)
    except (OSError, ValueError):
        return b""
