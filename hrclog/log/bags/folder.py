"""Which files make up a ROS 2 bag: a folder of parts with `metadata.yaml`, which is a hint and nothing more.

Recorders that are killed leave it out, empty or torn; copies lose parts; newer versions write what this one does not
know. So the parts are the logs in the folder, and all that is taken from the file are names that are missing there.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import islice
from pathlib import Path, PurePosixPath
from typing import Final

from hrclog.errors import LogReadError
from hrclog.log.files.names import BAG_METADATA, COMPRESSIONS, is_log_name, plain_name

_MOST_BYTES: Final = 1 << 20
_KEY: Final = re.compile(r"^[^\S\n]*relative_file_paths[^\S\n]*:", re.MULTILINE)
_LIST: Final = re.compile(r"(?:\s*+(\[[^\]]*+\]))?+[^\S\n]*+$", re.MULTILINE)
_MOST_LISTS: Final = 10  # that are looked at: each may reach to the end of the file
_QUOTES: Final = "'\""


@dataclass(frozen=True, slots=True)
class Bag:
    """The parts of a bag in the order of their numbers, and the names of parts that are listed and not there."""

    parts: list[Path]
    missing: list[str]


def is_bag(path: Path) -> bool:
    """Return whether a path is a ROS 2 bag folder."""
    return path.is_dir()


def open_bag(folder: Path) -> Bag:
    """Find the parts of a bag.

    Raises:
        LogReadError: there is none, or the folder cannot be opened.
    """
    try:
        names = {path.name for path in folder.iterdir() if path.is_file()}
    except OSError as error:
        raise LogReadError(folder, f"a folder that cannot be opened ({error.strerror})", "a ROS 2 bag") from error
    listed = _listed(folder / BAG_METADATA)
    parts = {name for name in names if is_log_name(name)} | (names & set(listed))
    missing = [name for name in listed if not names & _spellings(name)]
    if not parts:
        content = f"a folder with {BAG_METADATA} and no part of a bag"
        lost = f" (it lists {', '.join(missing)})" if missing else ""
        raise LogReadError(folder, content + lost, "files of mcap, db3 or bag beside it", "copy the parts there too")
    return Bag([folder / name for name in sorted(parts, key=_natural)], missing)


def _listed(metadata: Path) -> list[str]:
    """Return the names of the parts that a bag's metadata lists, as far as they can be read."""
    try:
        with metadata.open("rb") as stream:
            text = stream.read(_MOST_BYTES).decode(errors="replace")
    except OSError:
        return []
    keys = islice(_KEY.finditer(text), _MOST_LISTS)
    match = next(filter(None, (_LIST.match(text, key.end()) for key in keys)), None)
    if match is None:
        return []
    items = match.group(1)[1:-1].split(",") if match.group(1) else _items(text[match.end() + 1 :])
    names = (PurePosixPath(item.strip().strip(_QUOTES)).name for item in items)
    return list(dict.fromkeys(name for name in names if name))


def _items(text: str) -> list[str]:
    """Return the items of a list that a text begins with."""
    items: list[str] = []
    for line in text.split("\n")[:-1]:  # a last line without its end may be torn
        words = line.split(maxsplit=1)
        if len(words) == 2 and words[0] == "-":
            items.append(words[1])
        elif words:
            break
    return items


def _natural(name: str) -> list[tuple[int, str]]:
    """Return a key that sorts b_2 before b_10."""
    return [(int(word), "") if word.isdecimal() else (-1, word) for word in re.split(r"([0-9]+)", name)]


def _spellings(name: str) -> set[str]:
    """Return under which names a listed part may lie there: compressed, or no longer so."""
    return {name, plain_name(name), *(name + ending for ending in COMPRESSIONS)}
