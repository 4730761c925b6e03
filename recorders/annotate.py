"""Say something of runs afterwards, beside their logs."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from hrclog.diagnostic import Diagnostic
from hrclog.errors import HrclogError, InvalidEventError
from hrclog.log.annotations.add import annotate as add
from hrclog.log.annotations.said import Said
from hrclog.log.reader import Logs, read_log, read_logs
from hrclog.log.runs.facts import run_facts
from hrclog.log.runs.where import ALL_RUNS, Where
from hrclog.tags import checked_tags

_MOST_NAMED: Final = 10


@dataclass(frozen=True, slots=True)
class Annotated:
    """What was annotated: the names of runs by their ids, the files written, and what is doubtful about the logs."""

    runs: Mapping[str, str]
    written: list[Path]
    diagnostics: list[Diagnostic]


def annotate(
    paths: str | Path | Iterable[str | Path],
    tags: Mapping[str, str | float | None],
    *,
    runs: Iterable[str] = (),
    where: Where = ALL_RUNS,
    author: str = "",
) -> Annotated:
    """Give runs tags, beside their logs, which are not rewritten; what is said last holds.

    Args:
        paths: logs, folders and globs.
        tags: by key; None takes a tag back.
        runs: names or ids of the runs; without, all.
        where: which runs, by the tags that they have: texts such as participant=P01, or values by key.
        author: who says it.

    Raises:
        InvalidEventError: a tag is none, or there is none.
        HrclogError: no run is of such a name, or as `where` says.
        LogReadError: nothing matched, no file could be read, or annotations that are there are damaged.
        LogWriteError: annotations cannot be written.
    """
    said = Said(_said_tags(tags), author, time.time_ns())
    logs = read_logs([paths] if isinstance(paths, str | Path) else paths, where=where)
    names = _named(logs, list(runs))
    written = [path for log in logs.paths for path in _annotate(log, names, said)]
    return Annotated(names, written, logs.diagnostics)


def _said_tags(tags: Mapping[str, str | float | None]) -> dict[str, str]:
    taken_back = {key: "" for key, value in tags.items() if value is None}
    given = checked_tags({key: value for key, value in tags.items() if value is not None})
    checked_tags(dict.fromkeys(taken_back, "?"))  # their keys
    if not (given or taken_back):
        raise InvalidEventError("annotate: found no tag, expected at least one key and its value")
    return given | taken_back


def _named(logs: Logs, wanted: list[str]) -> dict[str, str]:
    """Return the names of the runs that are meant, by their ids."""
    names = {run: facts.name for run, facts in run_facts(logs.events).items()}
    if not wanted:
        return names
    for text in wanted:
        if text not in names and text not in names.values():
            known = sorted(names.values())
            more = f" and {len(known) - _MOST_NAMED} more" if len(known) > _MOST_NAMED else ""
            listed = ", ".join(map(repr, known[:_MOST_NAMED])) + more
            raise HrclogError(f"run {text!r}: found no such run, expected one of {listed}")
    return {run: name for run, name in names.items() if run in wanted or name in wanted}


def _annotate(log: Path, names: Mapping[str, str], said: Said) -> list[Path]:
    part = read_log(log)
    runs = sorted(set(part.events["run_id"]) & set(names))
    is_nameless = part.events["run_id"].n_unique() == 1 and any(f.code == "no_run_id" for f in part.diagnostics)
    return [add(log, part.events, runs, said, is_nameless=is_nameless)] if runs else []
