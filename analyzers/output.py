"""Write an analysis to a folder: JSON, Parquet and Rerun recordings."""

from __future__ import annotations

import hashlib
import os
import unicodedata
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl

from hrclog.analyzers.exporters.tables import Csv, Parquet
from hrclog.analyzers.result import Analysis
from hrclog.errors import LogReadError, OutputError
from hrclog.file_names import file_stem
from hrclog.file_sets import ANALYSIS_SET, is_unfinished, marker_name, replaced_set
from hrclog.files import write_whole
from hrclog.json_text import RESULT_JSON, read_json_file

JSON_NAME: Final = "analysis.json"
EXECUTIONS_NAME: Final = "executions.csv"  # what R, SPSS and spreadsheets are given
RECORDING_NAME: Final = "analysis.rrd"
RUNS_FOLDER: Final = "runs"
TABLES: Final = (
    "events",
    "signals",
    "intervals",
    "executions",
    "overlaps",
    "pair_overlaps",
    "durations",
    "synergies",
    "runs",
    "metrics",
)

MOST_RECORDINGS: Final = 200
"""How many runs get their own recording, unless the caller asks for another number."""

_LONGEST_NAME: Final = 100  # bytes, of the 255 that file systems take
_HASH_STEP: Final = 8


def save(
    analysis: Analysis,
    folder: Path,
    on_step: Callable[[], None] = lambda: None,
    most_recordings: int | None = MOST_RECORDINGS,
    drawn: Sequence[str] | None = None,
) -> None:
    """Write JSON, tables, the campaign's recording and recordings of single runs: all of them, or none.

    They replace those of an earlier analysis in the same folder as one set (`hrclog.file_sets`).

    Args:
        analysis: what to write.
        folder: created if it is missing.
        on_step: called after each recording, for progress.
        most_recordings: of single runs, None for all. If there are more runs, `drawn_runs` selects them.
        drawn: ids of the runs that get a recording, instead of so many.

    Raises:
        OutputError: the folder cannot be written.
    """
    drawn_ids = set(drawn_runs(analysis.runs, most_recordings) if drawn is None else drawn)
    names = {run: name for run, name in recording_names(analysis.runs).items() if run in drawn_ids}
    with replaced_set(folder, ANALYSIS_SET, older=lambda: _older_names(folder)) as new:
        (new / RUNS_FOLDER).mkdir()
        for table in TABLES:
            Parquet().write(getattr(analysis, table), new / f"{table}.parquet")
        Csv().write(analysis.executions, new / EXECUTIONS_NAME)
        analysis.to_rerun(new / RECORDING_NAME)
        on_step()
        for run_id, name in names.items():
            analysis.run_to_rerun(run_id, new / RUNS_FOLDER / name)
            on_step()
        write_whole(new / JSON_NAME, f"{analysis.to_json()}\n".encode())


def drawn_runs(runs: pl.DataFrame, most: int | None) -> list[str]:
    """Return the ids of the runs to draw: all, or `most` of them, evenly spread from the first to the last.

    Args:
        runs: a frame of schema `RUNS`.
        most: how many, None for all.
    """
    ids: list[str] = runs["run_id"].to_list()
    if most is None or len(ids) <= most:
        return ids
    return [ids[index] for index in np.linspace(0, len(ids) - 1, most).round().astype(int).tolist()]


def check_writable(folder: Path) -> None:
    """Raise before the work, rather than after it, if the results cannot be written to a folder.

    Raises:
        OutputError: the folder cannot be made or written.
    """
    existing = next(path for path in (folder.absolute(), *folder.absolute().parents) if path.exists())
    if not existing.is_dir():
        raise OutputError(folder, f"cannot be made, {existing} is no folder")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise OutputError(folder, f"cannot be written, {existing} gives no permission")


def check_finished(path: str | Path) -> None:
    """Raise if a path is a folder whose results may be of two analyses.

    Raises:
        LogReadError: it is.
    """
    if is_unfinished(Path(path), ANALYSIS_SET):
        found = f"results that are being replaced, or whose writing was broken off ({marker_name(ANALYSIS_SET)})"
        remedy = f"run hrclog analyze LOG... -o {path} again"
        raise LogReadError(path, found, "the results of one analysis", remedy)


def recording_names(runs: pl.DataFrame) -> dict[str, str]:
    """Return run_id -> file name: the run's name, made safe, with a hash of its id if two names would be one file.

    The names do not depend on the order of the runs.
    """
    stems = {run: _stem(name) for run, name in runs.select("run_id", "name").iter_rows()}
    lengths = dict.fromkeys(stems, 0)
    names = stems
    while alike := _find_alike(names):  # a name with a hash may be the name of another run
        lengths |= {run: lengths[run] + _HASH_STEP for run in alike}
        names = {run: _append_hash(stem, run, lengths[run]) for run, stem in stems.items()}
    return {run: f"{name}.rrd" for run, name in names.items()}


def _stem(name: str) -> str:
    # file systems count bytes, and a character has up to four
    return file_stem(name, _LONGEST_NAME) or "run"


def _append_hash(stem: str, run_id: str, length: int) -> str:
    return f"{stem}-{hashlib.sha256(run_id.encode()).hexdigest()[:length]}" if length else stem


def _find_alike(names: dict[str, str]) -> list[str]:
    """Return the runs whose names some file systems cannot distinguish from another name."""
    folded = {run: _fold_name(name) for run, name in names.items()}
    counts = Counter(folded.values())
    return [run for run, name in folded.items() if counts[name] > 1]


def _fold_name(name: str) -> str:
    return unicodedata.normalize("NFD", unicodedata.normalize("NFD", name).casefold())


def _older_names(folder: Path) -> Iterable[str]:
    """Return the names of the recordings that an analysis without a manifest wrote, as its JSON says."""
    try:
        last = read_json_file(folder / JSON_NAME, RESULT_JSON)
        rows = [(row["run_id"], row["name"]) for row in last["runs"]]
        names = recording_names(pl.DataFrame(rows, schema={"run_id": pl.String, "name": pl.String}, orient="row"))
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return ()
    return [f"{RUNS_FOLDER}/{name}" for name in names.values()]
