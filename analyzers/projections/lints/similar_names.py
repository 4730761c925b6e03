"""Names of agents or tasks that a reader takes for one: they differ only in what is easily overlooked."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Mapping
from typing import Final

import polars as pl

from hrclog.analyzers.projections.lints.record import Record
from hrclog.diagnostic import Diagnostic
from hrclog.wording import counted

_INVISIBLE: Final = ("Cc", "Cf", "Zs", "Zl", "Zp")
_BLANK: Final = frozenset("\u034f\u115f\u1160\u17b4\u17b5\u180b\u180c\u180d\u180f\u2800\u3164\uffa0") | frozenset(
    map(chr, (*range(0xFE00, 0xFE10), *range(0xE0100, 0xE01F0)))
)
"""Characters without a glyph whose category does not say so."""

_MOST_NAMES: Final = 8


def alike_names(record: Record) -> list[Diagnostic]:
    """Find names that are alike, of tasks and of the agents of all events and those that runs declare."""
    agents = {*record.events["agent"].unique(), *record.runs["agents"].explode().drop_nulls()} - {""}
    return similar_names(record.intervals, agents)


def similar_names(intervals: pl.DataFrame, agents: Iterable[str] = ()) -> list[Diagnostic]:
    """Find agents, and tasks, whose names differ only in case, spaces, composition or invisible characters.

    Args:
        intervals: a frame of schema `INTERVALS`.
        agents: further names of agents, which may have no execution.
    """
    paths = intervals["path"].unique()
    place = str(paths[0]) if len(paths) == 1 else ""
    counts = {kind: dict[str, int](intervals.group_by(kind).len().iter_rows()) for kind in ("agent", "task")}
    counts["agent"] = dict.fromkeys(agents, 0) | counts["agent"]
    return [
        Diagnostic("similar_names", _text(kind, group), place)
        for kind, names in counts.items()
        for group in _groups(names)
    ]


def folded(name: str) -> str:
    """Return what is left of a name without case, spaces, composition and invisible characters."""
    if name.isascii() and name.isprintable():
        return name.replace(" ", "").casefold()
    canonical = unicodedata.normalize("NFD", unicodedata.normalize("NFD", name).casefold())
    return unicodedata.normalize("NFC", "".join(char for char in canonical if not _is_invisible(char)))


def visible(name: str) -> str:
    """Return a name in quotes in which what cannot be seen, or looks the same in another form, is an escape."""
    shown = repr(name)
    if shown.isascii():
        return shown
    return "".join(
        char.encode("unicode_escape").decode() if char in _BLANK or unicodedata.category(char)[0] == "M" else char
        for char in shown
    )


def _groups(counts: Mapping[str, int]) -> Iterable[list[tuple[str, int]]]:
    """Return (name, executions) of the names that are alike, both in order."""
    alike: dict[str, list[tuple[str, int]]] = {}
    for name, count in sorted(counts.items()):
        alike.setdefault(folded(name), []).append((name, count))
    return [group for group in alike.values() if len(group) > 1]


def _text(kind: str, group: list[tuple[str, int]]) -> str:
    names = [f"{visible(name)} ({counted(count, 'execution')})" for name, count in group[:_MOST_NAMES]]
    if len(group) > _MOST_NAMES:
        names.append(f"and {len(group) - _MOST_NAMES} more")
    return (
        f"{counted(len(group), f'name of {kind}s', f'names of {kind}s')} differ only in case, spaces, composition or "
        f"invisible characters: {', '.join(names)}; are they one {kind}?"
    )


def _is_invisible(char: str) -> bool:
    return char in _BLANK or unicodedata.category(char) in _INVISIBLE
