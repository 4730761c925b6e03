"""The authors' runs as tables of every kind: what is imported is what the import of their dumps gives."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from polars.testing import assert_frame_equal
from real_runs import import_some
from sizes import many

import hrclog
from hrclog.recorders.importers.table.importer import TableImporter
from hrclog.recorders.importers.writing import import_files

pytestmark = pytest.mark.slow

N_RUNS = many(4, fuzz=51)
MS = 10**6
Write = Callable[[pl.DataFrame, Path], Path]


@pytest.fixture(scope="module")
def dumps(data_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> hrclog.Analysis:
    """Return the analysis of some of the authors' runs, as their dumps give them."""
    return hrclog.analyze(import_some(data_dir, tmp_path_factory.mktemp("mongo"), N_RUNS))


def iso(ns: int) -> str:
    return f"{datetime.fromtimestamp(ns // 10**9, UTC):%Y-%m-%dT%H:%M:%S}.{ns % 10**9:09d}Z"


def seconds(ns: int) -> str:
    return f"{ns // 10**9}.{ns % 10**9:09d}"


def executions(analysis: hrclog.Analysis, cell: Callable[[int], Any]) -> pl.DataFrame:
    """Return a row per execution, its instants as `cell` writes them."""
    names = dict(analysis.runs.select("run_id", "name").iter_rows())
    intervals = analysis.intervals
    return intervals.select(
        pl.Series("run", [names[run] for run in intervals["run_id"]]),
        "agent",
        "task",
        pl.Series("start", [cell(ns) for ns in intervals["start_ns"]]),
        pl.Series("end", [cell(ns) for ns in intervals["end_ns"]]),
        "outcome",
    )


def events(analysis: hrclog.Analysis) -> pl.DataFrame:
    """Return a row per start and per end."""
    rows = executions(analysis, iso)
    facts = pl.col("run", "agent", "task")
    starts = rows.select(facts, pl.lit("start").alias("event"), time="start", outcome=pl.lit(""))
    ends = rows.select(facts, pl.lit("complete").alias("event"), "outcome", time="end")
    return pl.concat([starts, ends.select(starts.columns)]).sort("time", "event", "run", "agent")


def since_the_start(analysis: hrclog.Analysis) -> pl.DataFrame:
    rows = executions(analysis, int)
    origins = pl.col("start").min().over("run")
    shifted = rows.with_columns(pl.col("start", "end") - origins, began=origins)
    return shifted.with_columns(
        *(pl.Series(name, [seconds(ns) for ns in shifted[name]]) for name in ("start", "end")),
        pl.Series("began", [iso(ns) for ns in shifted["began"]]),
    )


def date_cell(ns: int) -> datetime:
    return datetime.fromtimestamp(0, UTC).replace(tzinfo=None) + timedelta(milliseconds=round(ns / MS))


def csv(frame: pl.DataFrame, path: Path) -> Path:
    frame.write_csv(path.with_suffix(".csv"))
    return path.with_suffix(".csv")


def parquet(frame: pl.DataFrame, path: Path) -> Path:
    frame.write_parquet(path.with_suffix(".parquet"))
    return path.with_suffix(".parquet")


def json_lines(frame: pl.DataFrame, path: Path) -> Path:
    frame.write_ndjson(path.with_suffix(".jsonl"))
    return path.with_suffix(".jsonl")


def workbook(frame: pl.DataFrame, path: Path) -> Path:
    pytest.importorskip("xlsxwriter")
    frame.write_excel(path.with_suffix(".xlsx"), dtype_formats={pl.Datetime: "yyyy-mm-dd hh:mm:ss.000"})
    return path.with_suffix(".xlsx")


KINDS: dict[str, tuple[Callable[[hrclog.Analysis], pl.DataFrame], Write, dict[str, Any], int]] = {
    "csv-iso": (lambda analysis: executions(analysis, iso), csv, {}, 0),
    "csv-epoch": (lambda analysis: executions(analysis, seconds), csv, {}, 0),
    "csv-since-start": (since_the_start, csv, {"run_start": "began"}, 0),
    "csv-events": (events, csv, {}, 0),
    "xlsx-dates": (lambda analysis: executions(analysis, date_cell), workbook, {}, MS),
    "xlsx-texts": (lambda analysis: executions(analysis, iso), workbook, {}, 0),
    "parquet": (lambda analysis: executions(analysis, int), parquet, {}, 0),
    "jsonl": (lambda analysis: executions(analysis, int), json_lines, {}, 0),
}
"""By name: makes the rows, writes them, options of the import, and the resolution, ns."""


@pytest.mark.parametrize("kind", KINDS)
def test_tables_of_the_authors_runs_give_what_their_dumps_give(
    kind: str, dumps: hrclog.Analysis, tmp_path: Path
) -> None:
    make, write, options, resolution_ns = KINDS[kind]
    source = write(make(dumps), tmp_path / "runs")
    imported = import_files(TableImporter(), [source], tmp_path / "logs", **options)
    assert (len(imported.runs), imported.n_executions) == (dumps.runs.height, dumps.intervals.height)
    assert [finding for finding in imported.diagnostics if finding.severity != "info"] == []
    analysis = hrclog.analyze(tmp_path / "logs")
    columns = ("agent", "task", "start_ns", "end_ns", "outcome")
    there, here = (found.intervals.select(columns).sort(columns) for found in (dumps, analysis))
    for name in ("start_ns", "end_ns"):
        assert (there[name] - here[name]).abs().max() <= resolution_ns  # type: ignore[operator]  # int64
    assert here.drop("start_ns", "end_ns").equals(there.drop("start_ns", "end_ns"))
    # sums are in another order of the runs
    tolerance = max(1e-6, resolution_ns / 1e9)
    figures = ("agent", "task", "count", "n_failed", "success_rate", "mean_s", "std_s")
    assert_frame_equal(analysis.durations.select(figures), dumps.durations.select(figures), abs_tol=tolerance)
    values = ("agent", "task", "other_agent", "other_task", "synergy", "std_err", "n")
    assert_frame_equal(analysis.synergies.select(values), dumps.synergies.select(values), rel_tol=tolerance)
    again = import_files(TableImporter(), [source], tmp_path / "logs", **options)
    assert (again.written, len(again.unchanged)) == ([], len(imported.written))
