"""Write an analysis to a folder: JSON, Parquet and Rerun recordings."""

from __future__ import annotations

import hashlib
import os
import unicodedata
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl

from hrclog.analyzers.exporters.tables import Csv
from hrclog.analyzers.result import Analysis
from hrclog.errors import OutputError
from hrclog.file_names import file_stem
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
) -> None:
    """Write JSON, tables, the campaign's recording and recordings of single runs.

    Recordings of an earlier analysis in the same folder are removed if this one does not write them.

    Args:
        analysis: what to write.
        folder: created if it is missing.
        on_step: called after each recording, for progress.
        most_recordings: of single runs, None for all. If there are more runs, `drawn_runs` selects them.

    Raises:
        OutputError: the folder cannot be written.
    """
    drawn_ids = set(drawn_runs(analysis.runs, most_recordings))
    names = {run: name for run, name in recording_names(analysis.runs).items() if run in drawn_ids}
    try:
        (folder / RUNS_FOLDER).mkdir(parents=True, exist_ok=True)
        _remove_stale(folder, set(names.values()))
        for table in TABLES:
            frame: pl.DataFrame = getattr(analysis, table)
            frame.write_parquet(folder / f"{table}.parquet")
        Csv().write(analysis.executions, folder / EXECUTIONS_NAME)
        analysis.to_rerun(folder / RECORDING_NAME)
        on_step()
        for run_id, name in names.items():
            analysis.run_to_rerun(run_id, folder / RUNS_FOLDER / name)
            on_step()
        (folder / JSON_NAME).write_text(analysis.to_json() + "\n", encoding="utf-8")
    except OSError as error:
        raise OutputError(error.filename or folder, f"cannot be written ({error.strerror or error})") from error


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


def _remove_stale(folder: Path, current: set[str]) -> None:
    """Remove the run recordings that the last analysis in this folder wrote, as its JSON says."""
    try:
        last = read_json_file(folder / JSON_NAME, RESULT_JSON)
        rows = [(row["run_id"], row["name"]) for row in last["runs"]]
        names = recording_names(pl.DataFrame(rows, schema={"run_id": pl.String, "name": pl.String}, orient="row"))
    except (OSError, ValueError, KeyError, TypeError):
        return
    for name in set(names.values()) - current:
        (folder / RUNS_FOLDER / name).unlink(missing_ok=True)
