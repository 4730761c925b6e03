"""Select the recordings to open: those of an analysis, or of runs chosen by name."""

from __future__ import annotations

import fnmatch
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from hrclog.errors import LogReadError
from hrclog.json_text import RESULT_JSON, read_json_file
from hrclog.wording import agree, counted

if TYPE_CHECKING:
    import polars as pl

MOST_RUNS: Final = 20
"""The most recordings of runs that a folder opens, unless runs are chosen by name."""

_NAMED: Final = 5
_HOW: Final = "--run takes a part of a name or a glob"


@dataclass(frozen=True, slots=True)
class Chosen:
    """Recordings to open; a viewer shows the last one. `note` says what is left out, "" if nothing is."""

    paths: tuple[Path, ...]
    note: str = ""


def recordings_at(target: Path, patterns: Sequence[str] = ()) -> Chosen | None:
    """Return the recordings of a target, None if it must be analysed first.

    Args:
        target: an .rrd, the folder of an analysis, a log or a folder of logs.
        patterns: parts of names of runs, or globs. Of a folder, only runs that match one are opened.

    Raises:
        LogReadError: the target does not exist, its results are unfinished, or no run has such a name.
    """
    from hrclog.analyzers.output import check_finished

    if not target.exists():
        raise LogReadError(target, "nothing", "a log, an .rrd or the folder of an analysis", "check the path")
    if target.suffix == ".rrd" and not target.is_dir():
        return Chosen((target,))
    if not target.is_dir():
        return None
    check_finished(target)
    campaign, runs = sorted(target.glob("*.rrd")), sorted(target.glob("runs/*.rrd"))
    if not (campaign or runs):
        return None
    if not patterns:
        return Chosen((*runs[:MOST_RUNS], *campaign), _left_out_note(runs, MOST_RUNS, _run_names(target)))
    matching = [path for path in runs if matches(path.stem, patterns)]
    if not matching:
        raise _missing_run_error(target, runs, patterns)
    return Chosen((*campaign, *reversed(matching)))


def matching_runs(runs: pl.DataFrame, patterns: Sequence[str], target: Path) -> list[str]:
    """Return the ids of the runs whose name or recording's name matches.

    Args:
        runs: schema `RUNS`.
        patterns: parts of names, or globs.
        target: where the runs come from, for the error.

    Raises:
        LogReadError: none does.
    """
    from hrclog.analyzers.output import recording_names

    files = recording_names(runs)
    names_by_id = dict(runs.select("run_id", "name").iter_rows())
    matching = [
        run for run, name in names_by_id.items() if matches(name, patterns) or matches(_stem(files[run]), patterns)
    ]
    if not matching:
        raise LogReadError(target, _no_run_text(patterns), f"one of {_list_names(list(names_by_id.values()))}", _HOW)
    return matching


def matches(name: str, patterns: Sequence[str]) -> bool:
    """Return whether a name contains one of the texts or matches one of the globs, whatever the case of letters."""
    folded = name.casefold()
    return any(
        fnmatch.fnmatchcase(folded, pattern) if any(char in pattern for char in "*?[") else pattern in folded
        for pattern in map(str.casefold, patterns)
    )


def _left_out_note(runs: Sequence[Path], most: int, names: Sequence[str]) -> str:
    """Return a note on the runs that are not opened or were never drawn."""
    unopened = runs[most:]
    is_partial = len(names) > len(runs)
    if not unopened:
        have = agree(len(runs), "has a recording", "have recordings")
        more = "hrclog analyze --recordings all draws each"
        return f"{len(runs):,} of {len(names):,} runs {have}; {more}" if is_partial else ""
    drawn = f"{counted(len(runs), 'recording')} of the {len(names):,} runs" if is_partial else counted(len(runs), "run")
    which = unopened[0].stem if len(unopened) == 1 else f"{unopened[0].stem} .. {unopened[-1].stem}"
    return f"opening {most} of {drawn}; left out: {len(unopened):,}, {which}; --run NAME chooses"


def _missing_run_error(folder: Path, runs: Sequence[Path], patterns: Sequence[str]) -> LogReadError:
    undrawn = [name for name in _run_names(folder) if matches(name, patterns)]
    if undrawn:
        problem = f"no recording of {_list_names(undrawn)}, which was analysed but not drawn"
        remedy = "hrclog analyze --recordings all draws each run, hrclog view LOG a single one"
        return LogReadError(folder, problem, "one", remedy)
    return LogReadError(folder, _no_run_text(patterns), f"one of {_list_names([path.stem for path in runs])}", _HOW)


def _no_run_text(patterns: Sequence[str]) -> str:
    return f"no run with {' or '.join(map(repr, patterns))} in its name"


def _stem(file: str) -> str:
    return file.removesuffix(".rrd")


def _list_names(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED:,} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more


def _run_names(folder: Path) -> list[str]:
    """Return the names of the analysed runs, [] if the folder does not say them."""
    try:
        rows = read_json_file(folder / "analysis.json", RESULT_JSON)["runs"]
        return [str(row["name"]) for row in rows]
    except (OSError, ValueError, KeyError, TypeError):
        return []
