"""Search a folder to any depth for logs: each once, in one order, whatever links there are."""

from __future__ import annotations

import os
import stat
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from hrclog.file_sets import ANALYSIS_SET, marker_name
from hrclog.log.files.names import BAG_METADATA, is_annotations_name, is_log_name

RESULTS_FILE: Final = "analysis.json"
"""What `hrclog analyze` writes into every folder of results, and writes last."""

UNFINISHED_RESULTS: Final = marker_name(ANALYSIS_SET)
"""What lies in a folder of results while they are replaced, and stays where that is broken off."""

_BESIDE_RESULTS: Final = frozenset({"analysis.rrd", "events.parquet"})
_RESULTS_KEY: Final = b'"hrclog_version"'
_BAG_KEY: Final = b"rosbag2_bagfile_information"
_HEAD_BYTES: Final = 1 << 16
_ENVIRONMENT: Final = "pyvenv.cfg"  # in the top folder of an installed Python, whose packages hold samples
_NOT_SEARCHED: Final = frozenset(
    {"__MACOSX", "__pycache__", "node_modules", "lost+found", "System Volume Information", "$RECYCLE.BIN", "@eaDir"}
)

Identity = tuple[int, int] | Path
"""Device and number of a file or folder; its path where the system has no such numbers, or the file is not there."""

_Entry = tuple[bool, tuple[str, ...], Path]
"""Whether a link led there, the parts of the path, and the path: of the names of a log the least counts."""


@dataclass(frozen=True, slots=True)
class Searched:
    """What a folder holds, to any depth.

    Attributes:
        logs: files and ROS 2 bag folders by identity, in order of the parts of their paths.
        unreadable: folders that cannot be opened, and why.
        results: folders of results, which were not searched.
        annotations: files that hold annotations.
    """

    logs: dict[Identity, Path]
    unreadable: list[tuple[Path, str]]
    results: list[Path]
    annotations: list[Path]


def search(folder: Path) -> Searched:
    """Search a folder. Hidden folders, those of tools and those of results are left out, unless it is one itself.

    Links are followed once, and not to a folder that they, or the folder that is searched, lie in. Of several names of
    a file the one that needs no link counts, and of those the first.
    """
    scan = _Search(folder)
    scan.run()
    logs = {identity: entry[-1] for identity, entry in scan.logs.items() if identity not in scan.parts}
    return Searched(
        dict(sorted(logs.items(), key=lambda item: item[1].parts)),
        sorted(scan.unreadable, key=lambda item: item[0].parts),
        sorted(scan.results, key=lambda path: path.parts),
        sorted(scan.annotations, key=lambda path: path.parts),
    )


def identity_of(path: Path) -> Identity:
    """Return what is the same for all names of a file or folder."""
    try:
        return _identity(path, path.stat())
    except (OSError, ValueError):  # ValueError: a name that no file can have
        return path


class _Search:
    def __init__(self, root: Path) -> None:
        self.logs: dict[Identity, _Entry] = {}
        self.parts: set[Identity] = set()  # of bags, which are read as a whole
        self.unreadable: list[tuple[Path, str]] = []
        self.results: list[Path] = []
        self.annotations: list[Path] = []
        self._root, self._real_root = root, os.path.realpath(root)
        self._folders: set[Identity] = set()
        self._links: list[Path] = []

    def run(self) -> None:
        """Search real folders first, then what links lead to, so that the answer does not depend on the order."""
        self._walk(self._root, by_link=False)
        while self._links:
            links, self._links = sorted(self._links, key=lambda path: path.parts), []
            for link in links:
                self._walk(link, by_link=True)

    def _walk(self, top: Path, *, by_link: bool) -> None:
        folders = [top]
        while folders:
            folder = folders.pop()
            identity = identity_of(folder)
            if identity in self._folders:
                continue
            self._folders.add(identity)
            try:
                with os.scandir(folder) as scanned:
                    entries = sorted(scanned, key=lambda entry: entry.name)
            except OSError as error:
                self.unreadable.append((folder, error.strerror or str(error)))
                continue
            if folder != self._root and self._is_passed_over(folder, {entry.name for entry in entries}):
                continue
            folders += self._take(folder, entries, by_link=by_link)

    def _is_passed_over(self, folder: Path, names: set[str]) -> bool:
        if _ENVIRONMENT in names:
            return True
        is_results = BAG_METADATA not in names and _holds_results(folder, names)
        if is_results:
            self.results.append(folder)
        return is_results

    def _leads_up(self, link: Path) -> bool:
        """Return whether a link leads to a folder that it lies in, or that holds the folder that is searched."""
        target = os.path.realpath(link)
        return any(
            place == target or place.startswith(target.rstrip(os.sep) + os.sep)
            for place in (os.path.realpath(link.parent), self._real_root)
        )

    def _take(self, folder: Path, entries: Sequence[os.DirEntry[str]], *, by_link: bool) -> list[Path]:
        """Keep the logs right in a folder, and return the folders there; links to others are kept for later."""
        folders: list[Path] = []
        logs: dict[Identity, _Entry] = {}
        for entry in entries:
            path, is_link = folder / entry.name, entry.is_symlink()
            kind, identity = _kind_of(entry, path)
            if is_annotations_name(entry.name):
                self.annotations.append(path)
            if kind == "log":
                _keep_first(logs, identity, (by_link or is_link, path.parts, path))
            elif kind == "folder" and not is_link:
                folders.append(path)
            elif kind == "folder" and not self._leads_up(path):
                self._links.append(path)
        if any(entry.name == BAG_METADATA for entry in entries) and (logs or _BAG_KEY in _head(folder / BAG_METADATA)):
            self.parts.update(logs)
            logs = {identity_of(folder): (by_link, folder.parts, folder)}
        for identity, log in logs.items():
            _keep_first(self.logs, identity, log)
        return folders[::-1]


def _kind_of(entry: os.DirEntry[str], path: Path) -> tuple[Literal["log", "folder", "other"], Identity]:
    """Return what an entry of a folder, or the target of a link, is to the search."""
    is_log, is_link = is_log_name(entry.name), entry.is_symlink()
    if not is_log and not is_link:
        is_folder = entry.is_dir(follow_symlinks=False) and _is_searched(entry.name)
        return "folder" if is_folder else "other", path
    try:
        status = path.stat()
    except OSError:  # a link to nothing, or to itself, is kept, so that reading it says so
        return "log" if is_log and is_link else "other", path
    if stat.S_ISDIR(status.st_mode):
        return "folder" if _is_searched(entry.name) else "other", path
    return "log" if is_log and stat.S_ISREG(status.st_mode) else "other", _identity(path, status)


def _keep_first(logs: dict[Identity, _Entry], identity: Identity, entry: _Entry) -> None:
    logs[identity] = min(entry, logs.get(identity, entry))


def _is_searched(name: str) -> bool:
    """Return whether a folder of that name is searched: those of tools and hidden ones hold no logs of a user's."""
    return not name.startswith(".") and name not in _NOT_SEARCHED


def _holds_results(folder: Path, names: Collection[str]) -> bool:
    """Return whether a folder was written by `hrclog analyze`, and not just holds a file of that name."""
    if UNFINISHED_RESULTS in names and _RESULTS_KEY in _head(folder / UNFINISHED_RESULTS):
        return True
    if RESULTS_FILE not in names:
        return False
    return not _BESIDE_RESULTS.isdisjoint(names) or _RESULTS_KEY in _head(folder / RESULTS_FILE)


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            return stream.read(_HEAD_BYTES)
    except OSError:
        return b""


def _identity(path: Path, status: os.stat_result) -> Identity:
    return (status.st_dev, status.st_ino) if status.st_ino else Path(os.path.realpath(path))
