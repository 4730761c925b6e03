"""Files that belong together and are replaced as one set, whatever else lies in their folder.

A set is written into a hidden folder and then moved to its place. While its files are moved, a marker lies in the
folder: it stays where the process is killed, and says that files of two sets may be mixed. Where the names of the files
are not always the same, a manifest lists them, so that the next set of that kind takes away those that it has not.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from typing import Final

from hrclog._version import __version__
from hrclog.files import hidden_folder, is_at, lock, output_errors, put, target_of, write_whole

ANALYSIS_SET: Final = "analysis"
"""The kind of the set that `hrclog analyze` writes."""

ABOUT_MARKER: Final = "The files named here may be of two different sets; run the command that writes them again."
_MOST_BYTES: Final = 1 << 26
_ANY: Final = ""
"""Stands for the hash of a file whose set has no manifest."""

Hashes = dict[str, frozenset[str]]
"""Per name of a file, relative to its folder, the hashes of the contents that are of a set."""


def marker_name(kind: str) -> str:
    """Return the name of the file that marks a set as unfinished."""
    return f"{kind}.unfinished"


def manifest_name(kind: str) -> str:
    """Return the name of the file that lists the files of a set."""
    return f".hrclog.{kind}"


def is_unfinished(folder: Path, kind: str) -> bool:
    """Return whether a set may be mixed: it is being replaced, or that was broken off."""
    try:
        return (folder / marker_name(kind)).stat().st_size > 0
    except (OSError, ValueError):  # ValueError: a name that no file can have
        return False


def unfinished_names(folder: Path, kind: str) -> frozenset[str]:
    """Return the names of the files of a set that is unfinished."""
    marker = folder / marker_name(kind)
    return frozenset(_hashes(_read(marker))) if is_unfinished(folder, kind) else frozenset()


@contextmanager
def replaced_set(
    folder: Path, kind: str, *, older: Callable[[], Iterable[str]] = tuple, keeps: bool = False
) -> Iterator[Path]:
    """Yield a hidden folder to write a set of files into; at the end it replaces the set of that kind in `folder`.

    An error on the way leaves the old set as it was. A kill does so too, or leaves the set marked as unfinished.

    Args:
        folder: of the set; made if it is missing.
        kind: of the set; its manifest and marker bear it in their names.
        older: returns names that a set without a manifest may have.
        keeps: whether files of the old set that the new one does not have are kept; such sets have no manifest.

    Raises:
        OutputError: a file cannot be written.
    """
    with output_errors(folder):
        is_there = folder.is_dir()
        folder.mkdir(parents=True, exist_ok=True)
        try:
            with hidden_folder(folder) as new:
                yield new
                _swap(new, folder, kind, older, keeps=keeps)
        except BaseException:
            if not is_there:
                with suppress(OSError):
                    folder.rmdir()
            raise


def _swap(new: Path, folder: Path, kind: str, older: Callable[[], Iterable[str]], *, keeps: bool) -> None:
    written = sorted(new.rglob("*"))
    names = [path.relative_to(new).as_posix() for path in written if not path.is_dir()]
    current = {name: frozenset({_hash(new / name)}) for name in names}
    _check_places(folder, names)
    for path in written:
        if path.is_dir():
            (folder / path.relative_to(new)).mkdir(parents=True, exist_ok=True)
    marker = _Marker(folder, kind)
    try:
        before: Hashes = marker.hashes
        if not keeps:
            before = _union(_hashes(_read(folder / manifest_name(kind))), before)
            before = before or {name: frozenset({_ANY}) for name in older() if _is_within(name)}
            write_whole(new / manifest_name(kind), _line(current).encode())
            names.append(manifest_name(kind))
        others = sorted(before.keys() - current.keys()) if not keeps else []
        gone = [folder / name for name in others if _is_still(folder / name, before[name])]
        marker.begin(_union(before, current))
        _move([(new / name, folder / name) for name in names], gone, new, marker)
        marker.remove()
    finally:
        marker.close()


def _check_places(folder: Path, names: Iterable[str]) -> None:
    """Raise where a file cannot take its place, before anything is moved."""
    for name in names:
        place = target_of(folder / name)
        if place.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), os.fspath(folder / name))
        if place.exists() and not os.access(place, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), os.fspath(folder / name))


def _move(moves: Sequence[tuple[Path, Path]], gone: Sequence[Path], new: Path, marker: _Marker) -> None:
    """Move files to their places and remove others; where that fails, put everything back."""
    aside = new / "aside"
    aside.mkdir()
    undo: list[tuple[Path | None, Path]] = []
    can_undo = True
    try:
        for number, place in enumerate((*(place for _, place in moves), *gone)):
            target = target_of(place)
            before = _linked(target, aside / str(number))
            can_undo = can_undo and (before is not None or not target.exists())
            undo.append((before, target))
            if number < len(moves):
                put(moves[number][0], target)
            else:
                target.unlink()
    except BaseException:
        for before, target in reversed(undo) if can_undo else ():
            if before is not None:
                before.replace(target)
            else:
                target.unlink(missing_ok=True)
        if can_undo:
            marker.restore()
        raise


def _linked(path: Path, link: Path) -> Path | None:
    """Return another name of a file, None where there is no file or it cannot have one there."""
    try:
        os.link(path, link)
    except (OSError, NotImplementedError):
        return None
    return link


class _Marker:
    """The file that marks a set as unfinished; who has it open and locked is the only one to replace the set.

    Each swap that begins adds a line, with the files of the set before and after it.
    """

    def __init__(self, folder: Path, kind: str) -> None:
        self._path = folder / marker_name(kind)
        self._fd: int | None = self._open()
        self.hashes = _hashes(_read(self._path))
        self._size = os.fstat(self._fd).st_size if self._fd is not None else 0
        self._is_settled = self._size == 0

    def begin(self, hashes: Hashes) -> None:
        line = _line(hashes, ABOUT_MARKER).encode()
        try:
            while line and self._fd is not None:
                line = line[os.write(self._fd, line) :]
        except OSError:
            self.restore()
            raise
        self._is_settled = False

    def restore(self) -> None:
        """Say no more than at first."""
        if self._fd is not None:
            os.ftruncate(self._fd, self._size)
        self._is_settled = self._size == 0

    def remove(self) -> None:
        """Say that the set is whole."""
        self._is_settled = True

    def close(self) -> None:
        try:
            if self._is_settled and os.name == "posix":
                self._path.unlink()
        finally:
            if self._fd is not None:
                os.close(self._fd)
                self._fd = None
        if self._is_settled and os.name != "posix":  # which removes no file that is open
            self._path.unlink()

    def _open(self) -> int:
        while True:
            fd = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
            lock(fd, wait=True)
            if is_at(fd, self._path):
                return fd
            os.close(fd)  # another process was done with its set meanwhile, and removed the marker


def _line(hashes: Mapping[str, frozenset[str]], about: str = "") -> str:
    value = ({"about": about} if about else {}) | {
        "hrclog_version": __version__,
        "files": {name: sorted(hashes[name]) for name in sorted(hashes)},
    }
    return json.dumps(value, ensure_ascii=False) + "\n"


def _hashes(text: str) -> Hashes:
    """Return what the lines of a marker or a manifest say together; a line that is not whole says nothing."""
    hashes: Hashes = {}
    for line in text.splitlines():
        try:
            files = {str(name): frozenset(map(str, values)) for name, values in json.loads(line)["files"].items()}
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            continue
        hashes = _union(hashes, {name: values for name, values in files.items() if _is_within(name)})
    return hashes


def _union(first: Hashes, second: Hashes) -> Hashes:
    none: frozenset[str] = frozenset()
    return {name: first.get(name, none) | second.get(name, none) for name in (*first, *second)}


def _is_within(name: str) -> bool:
    """Return whether a name stays in its folder; a manifest may come from anybody."""
    parts = PurePosixPath(name).parts
    return bool(parts) and parts[0] != "/" and ".." not in parts and not {"\\", ":", "\0"} & set(name)


def _is_still(path: Path, hashes: frozenset[str]) -> bool:
    """Return whether a file is what hrclog wrote: what somebody changed since is theirs."""
    try:
        return path.is_file() and (_ANY in hashes or _hash(path) in hashes)
    except OSError:
        return False


def _hash(path: Path) -> str:
    with path.open("rb") as stream:
        digest = hashlib.blake2b(digest_size=16)
        while block := stream.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def _read(path: Path) -> str:
    try:
        with path.open("rb") as stream:
            return stream.read(_MOST_BYTES).decode("utf-8", "replace")
    except OSError:
        return ""
