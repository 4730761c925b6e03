"""Say of files that are no logs which command imports them, ready to be typed."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from hrclog.errors import HrclogError, LogReadError, NoLogError

if TYPE_CHECKING:
    from hrclog.diagnostic import Diagnostic

_MOST_FILES: Final = 200  # of a folder that are looked at
_FOREIGN: Final = ("no_events", "not_imported")
_FAILED: Final = "unreadable_file"


def with_hint(error: HrclogError) -> str:
    """Return the text of an error, with the command that imports the file where it is not a log."""
    for cause in (error, error.__cause__):
        if isinstance(cause, NoLogError):
            return joined(str(error), import_line(cause.path, logs_too=False))
    return str(error)


def hinted(findings: Iterable[Diagnostic]) -> list[Diagnostic]:
    """Return findings, those of files that are no logs of hrclog with the command that imports them."""
    return [
        replace(finding, message=joined(finding.message, _line_for(finding)))
        if finding.path and finding.code in (*_FOREIGN, _FAILED)
        else finding
        for finding in findings
    ]


def other_importer_line(path: Path, used: str) -> str:
    """Return the command that imports a file by another importer than was used; "" if none does."""
    line = import_line(path, logs_too=True)
    return "" if line.startswith(f"hrclog import {used} ") else line


def joined(text: str, line: str) -> str:
    """Return a text with a command behind it, if there is one."""
    return f"{text}; import it with `{line}`" if line and line not in text else text


def import_line(path: Path, *, logs_too: bool) -> str:
    """Return the command that imports a file, or files of a folder: those that go like the first; "" if none can.

    Args:
        path: of the file, bag or folder.
        logs_too: whether it may be a file that hrclog reads as it is: a bag.
    """
    files = _files_at(path, logs_too=logs_too)
    for file in files:
        typed = _typed(file, logs_too=logs_too)
        if typed is None:
            continue
        importer, arguments = typed
        if logs_too or file == path:
            name = shell_quoted(str(path))
        else:
            alike = [other for other in files if other.parent == file.parent and other.suffix == file.suffix]
            is_several = len(alike) > 1 and all(_typed(other, logs_too=False) == typed for other in alike)
            name = _glob(file) if is_several and file.suffix.isprintable() else shell_quoted(str(file))
        return " ".join(["hrclog import", importer, name, *([arguments] if arguments else [])])
    return ""


def _glob(file: Path) -> str:
    return f"{shell_quoted(str(file.parent))}/*{shlex.quote(file.suffix)}"


def _typed(file: Path, *, logs_too: bool) -> tuple[str, str] | None:
    """Return the importer that a file fits, and what is typed behind its name."""
    from hrclog.log.files.formats import HEAD_BYTES, Format, recognise
    from hrclog.recorders.importers.heads import without_compression
    from hrclog.recorders.importers.importers import IMPORTERS

    head = _head(file)
    kind = recognise(without_compression(head)[:HEAD_BYTES])
    if not head or (kind in (Format.MCAP, Format.SQLITE, Format.ROS1, Format.RERUN) and not logs_too):
        return None
    for name in IMPORTERS.names():
        with suppress(Exception):  # an importer of another package may fail in any way
            arguments = IMPORTERS[name].arguments_for(head, file.name)
            if arguments is not None:
                return name, arguments
    return None


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
    return import_line(Path(finding.path), logs_too=False) if Path(finding.path).is_file() else ""


def _files_at(path: Path, *, logs_too: bool) -> list[Path]:
    """Return the file itself, the parts of a bag, or the first files of a folder, from its top."""
    from hrclog.log.bags.folder import open_bag
    from hrclog.log.files.search import RESULTS_FILE, UNFINISHED_RESULTS

    try:
        if not path.is_dir():
            return [path] if path.is_file() else []
        if logs_too:
            return open_bag(path).parts
    except (OSError, ValueError, LogReadError):
        return []
    files: list[Path] = []
    for folder, below, names in os.walk(path):
        below[:] = sorted(name for name in below if not name.startswith("."))
        if RESULTS_FILE in names or UNFINISHED_RESULTS in names:
            continue
        files += [file for name in sorted(names) if (file := Path(folder, name)).is_file()]
        if len(files) > _MOST_FILES:
            break
    return files[:_MOST_FILES]


def _head(path: Path) -> bytes:
    from hrclog.recorders.importers.heads import HEAD_BYTES

    try:
        with path.open("rb") as stream:
            return stream.read(HEAD_BYTES)
    except (OSError, ValueError):
        return b""
