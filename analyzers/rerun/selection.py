"""Which recordings to open: those of an analysis, or of runs that were chosen by name."""

from __future__ import annotations

import fnmatch
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from hrclog.errors import LogReadError
from hrclog.wording import agree, counted

if TYPE_CHECKING:
    import polars as pl

    from hrclog.analyzers.result import Analysis

MOST_RUNS: Final = 20
"""How many recordings of runs a folder opens, unless they are chosen."""

_NAMED: Final = 5
_HOW: Final = "--run takes a part of a name or a glob"


@dataclass(frozen=True, slots=True)
class Chosen:
    """Recordings to open, of which a viewer shows the last; `note` says what is left out, "" if nothing is."""

    paths: tuple[Path, ...]
    note: str = ""


def recordings_at(target: Path, patterns: Sequence[str] = ()) -> Chosen | None:
    """Return the recordings that a target stands for, None where it is to be analysed first.

    Args:
        target: an .rrd, the folder of an analysis, a log or a folder of logs.
        patterns: parts of names of runs, or globs; of a folder only runs that match one.

    Raises:
        LogReadError: there is nothing, or no run has such a name.
    """
    if not target.exists():
        raise LogReadError(target, "nothing", "a log, an .rrd or the folder of an analysis", "check the path")
    if target.suffix == ".rrd" and not target.is_dir():
        return Chosen((target,))
    if not target.is_dir():
        return None
    campaign, runs = sorted(target.glob("*.rrd")), sorted(target.glob("runs/*.rrd"))
    if not (campaign or runs):
        return None
    if not patterns:
        return Chosen((*runs[:MOST_RUNS], *campaign), _left_out(runs, MOST_RUNS, _run_names(target)))
    found = [path for path in runs if matches(path.stem, patterns)]
    if not found:
        raise _not_there(target, runs, patterns)
    return Chosen((*campaign, *reversed(found)))


def matching_runs(runs: pl.DataFrame, patterns: Sequence[str], target: Path) -> list[str]:
    """Return the ids of the runs whose name, or the name of whose recording, matches.

    Args:
        runs: schema `RUNS`.
        patterns: parts of names, or globs.
        target: where the runs come from, for the error.

    Raises:
        LogReadError: none does.
    """
    from hrclog.analyzers.output import recording_names

    files = recording_names(runs)
    named = dict(runs.select("run_id", "name").iter_rows())
    found = [run for run, name in named.items() if matches(name, patterns) or matches(_stem(files[run]), patterns)]
    if not found:
        raise LogReadError(target, _nothing(patterns), f"one of {_listed(list(named.values()))}", _HOW)
    return found


def draw(analysis: Analysis, run_ids: Iterable[str], folder: Path, on_run: Callable[[], None]) -> list[Path]:
    """Write the recordings of some runs beside that of an analysis, and return their paths.

    Args:
        analysis: of these runs, which was saved to the folder.
        run_ids: of the runs.
        folder: of the analysis.
        on_run: called after each, for progress.
    """
    from hrclog.analyzers.output import RUNS_FOLDER, recording_names

    files = recording_names(analysis.runs)
    paths: list[Path] = []
    for run_id in run_ids:
        paths.append(folder / RUNS_FOLDER / files[run_id])
        analysis.run_to_rerun(run_id, paths[-1])
        on_run()
    return paths


def matches(name: str, patterns: Sequence[str]) -> bool:
    """Return whether a name holds one of the texts, or is as one of the globs; capitals do not count."""
    folded = name.casefold()
    return any(
        fnmatch.fnmatchcase(folded, pattern) if any(char in pattern for char in "*?[") else pattern in folded
        for pattern in map(str.casefold, patterns)
    )


def _left_out(runs: Sequence[Path], most: int, names: Sequence[str]) -> str:
    """Return what is not opened, or was never drawn."""
    rest = runs[most:]
    partly = len(names) > len(runs)
    if not rest:
        have = agree(len(runs), "has a recording", "have recordings")
        more = "hrclog analyze --recordings all draws each"
        return f"{len(runs):,} of {len(names):,} runs {have}; {more}" if partly else ""
    drawn = f"{counted(len(runs), 'recording')} of the {len(names):,} runs" if partly else counted(len(runs), "run")
    which = rest[0].stem if len(rest) == 1 else f"{rest[0].stem} .. {rest[-1].stem}"
    return f"opening {most} of {drawn}; left out: {len(rest):,}, {which}; --run NAME chooses"


def _not_there(folder: Path, runs: Sequence[Path], patterns: Sequence[str]) -> LogReadError:
    undrawn = [name for name in _run_names(folder) if matches(name, patterns)]
    if undrawn:
        found = f"no recording of {_listed(undrawn)}, which was analysed but not drawn"
        remedy = "hrclog analyze --recordings all draws each run, hrclog view LOG a single one"
        return LogReadError(folder, found, "one", remedy)
    return LogReadError(folder, _nothing(patterns), f"one of {_listed([path.stem for path in runs])}", _HOW)


def _nothing(patterns: Sequence[str]) -> str:
    return f"no run with {' or '.join(map(repr, patterns))} in its name"


def _stem(file: str) -> str:
    return file.removesuffix(".rrd")


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED:,} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more


def _run_names(folder: Path) -> list[str]:
    """Return the names of the runs that were analysed, as far as the folder says."""
    try:
        rows = json.loads((folder / "analysis.json").read_text(encoding="utf-8"))["runs"]
        return [str(row["name"]) for row in rows]
    except (OSError, ValueError, KeyError, TypeError):
        return []
