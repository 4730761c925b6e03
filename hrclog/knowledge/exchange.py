"""A knowledge base as files: the four collections as JSON, and beside them what it takes to make it anew."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from itertools import chain
from pathlib import Path
from typing import Any, Final

import polars as pl

from hrclog.errors import HrclogError, ImportDataError
from hrclog.file_sets import is_unfinished, marker_name, replaced_set
from hrclog.files import write_whole
from hrclog.frame_files import write_by
from hrclog.json_text import RESULT_JSON, read_json_file
from hrclog.knowledge.base import KnowledgeBase
from hrclog.knowledge.documents import (
    Document,
    duration_documents,
    property_documents,
    recipes,
    result_documents,
    result_row,
    synergy_documents,
)
from hrclog.knowledge.properties import TaskProperties, properties_from_row, snapshot_id
from hrclog.knowledge.records import RunRecord, Version, results_frame
from hrclog.knowledge.rows import frame_schema
from hrclog.knowledge.tables import KNOWLEDGE_VERSION, TASK_RESULTS
from hrclog.knowledge.view import View
from hrclog.knowledge.write import put_withdrawal

REST: Final = "hrclog.json"
"""The file of what the four collections do not say."""

JSON_SET: Final = "kb-json"
"""The kind of the set of files that `export_json` writes."""

_REMEDY: Final = "export it again"


def export_json(kb: KnowledgeBase, folder: Path) -> list[tuple[Path, int]]:
    """Write the four collections, and what it takes to make the knowledge base anew.

    Returns:
        Path and number of documents of each collection.

    Raises:
        OutputError: a file cannot be written.
        KnowledgeError: the database fails.
    """
    with kb.view() as view:
        files = {"task_results": list(chain.from_iterable(run_documents(view).values())), **other_documents(view)}
        rest = _rest_json(view)
    with replaced_set(folder, JSON_SET, keeps=True) as new:
        for name, documents in files.items():
            _write(new / f"{name}.json", documents)
        _write(new / REST, rest)
    return [(folder / f"{name}.json", len(documents)) for name, documents in files.items()]


def run_documents(view: View) -> dict[str, list[Document]]:
    """Return the documents of task_results by run_id, but for withdrawn runs."""
    return dict(result_documents(view.results(), recipes(view.runs())))


def other_documents(view: View) -> dict[str, list[Document]]:
    """Return the documents of the other three collections."""
    durations = view.durations()
    return {
        "task_properties": property_documents(view.properties()),
        "task_durations": duration_documents(durations),
        "task_synergies": synergy_documents(view.synergies(), durations),
    }


def export_parquet(kb: KnowledgeBase, folder: Path) -> list[tuple[Path, int]]:
    """Write the four collections and the runs as Parquet files.

    Returns:
        Path and number of rows of each.

    Raises:
        OutputError: a file cannot be written.
        KnowledgeError: the database fails.
    """
    with kb.view() as view:
        frames = {
            "task_properties": pl.DataFrame([task.to_row() for task in view.properties()], _PROPERTIES),
            "task_results": view.results().drop("path"),
            "task_durations": view.durations(),
            "task_synergies": view.synergies(),
            "runs": pl.DataFrame([asdict(run) for run in view.runs()], _RUNS),
        }
    with replaced_set(folder, "kb-parquet", keeps=True) as new:
        for name, frame in frames.items():
            write_by(frame.write_parquet, new / f"{name}.parquet")
    return [(folder / f"{name}.parquet", frame.height) for name, frame in frames.items()]


_PROPERTIES: Final = pl.Schema(
    dict.fromkeys(("task", "task_type", "agents", "targets", "role", "expected_s"), pl.String())
)
_RUNS: Final = pl.Schema(
    dict.fromkeys(("run_id", "digest", "name", "outcome"), pl.String())
    | dict.fromkeys(("start_ns", "n_events", "n_executions"), pl.Int64())
    | {"snapshot": pl.String(), "withdrawn": pl.String()}
)


def is_export(folder: Path) -> bool:
    """Return whether a folder holds what `export_json` wrote."""
    return (folder / REST).is_file()


def import_json(kb: KnowledgeBase, folder: Path) -> tuple[dict[str, list[str]], tuple[str, str] | None]:
    """Take in what `export_json` wrote; statistics are not read, but are to be made anew.

    Returns:
        Ids of runs by what became of them (added, replaced, unchanged), and estimator and outliers of the statistics.

    Raises:
        ImportDataError: a file is missing or not what was written.
        KnowledgeError: the database fails.
    """
    if is_unfinished(folder, JSON_SET):
        found = f"files of an export that was broken off ({marker_name(JSON_SET)})"
        raise ImportDataError(folder, found, "what hrclog kb export wrote", _REMEDY)
    rest = _read(folder / REST)
    documents = _read(folder / "task_results.json")
    try:
        _check_version(folder / REST, rest["schema_version"])
        results = _results([*documents, *rest["withdrawn_results"]])
        records = [_record(run, rest["snapshots"], results) for run in rest["runs"]]
        withdrawals = {str(run): str(reason) for run, reason in rest["withdrawals"].items()}
        method = rest["statistics"] and (str(rest["statistics"]["estimator"]), str(rest["statistics"]["outliers"]))
    except HrclogError:
        raise
    except Exception as error:
        problem = f"{type(error).__name__}: {error}"
        raise ImportDataError(folder / REST, problem, "what hrclog kb export wrote", _REMEDY) from error
    run_ids: dict[str, list[str]] = {"added": [], "replaced": [], "unchanged": []}
    for record in records:
        run_ids[kb.put(record)].append(record.run_id)
    with kb.writing() as connection:
        existing = View(connection).withdrawals()
        for run_id, reason in withdrawals.items():
            put_withdrawal(connection, run_id, existing.get(run_id, reason))
    return run_ids, method


def _rest_json(view: View) -> dict[str, Any]:
    statistics = view.statistics()
    runs = view.runs()
    withdrawn = result_documents(view.results(withdrawn=True), recipes(runs))
    return {
        "schema_version": KNOWLEDGE_VERSION,
        "runs": [{name: value for name, value in asdict(run).items() if name != "withdrawn"} for run in runs],
        "snapshots": {key: [task.to_row() for task in tasks] for key, tasks in view.snapshots().items()},
        "withdrawals": view.withdrawals(),
        "withdrawn_results": list(chain.from_iterable(documents for _, documents in withdrawn)),
        "statistics": statistics and {name: value for name, value in asdict(statistics).items() if name != "runs"},
    }


def _check_version(path: Path, version: object) -> None:
    if version != KNOWLEDGE_VERSION:
        raise ImportDataError(path, f"schema version {version!r}", KNOWLEDGE_VERSION, _REMEDY)


def _results(documents: Iterable[Mapping[str, Any]]) -> dict[str, pl.DataFrame]:
    rows = [result_row(document) for document in documents]
    if None in rows:
        raise ValueError("a task result has no field hrclog")
    frame = results_frame(pl.DataFrame(rows, frame_schema(TASK_RESULTS), orient="row"))
    return {str(run): part for (run,), part in frame.partition_by("run_id", as_dict=True).items()}


def _record(run: Mapping[str, Any], snapshots: Mapping[str, Any], results: Mapping[str, pl.DataFrame]) -> RunRecord:
    tasks: tuple[TaskProperties, ...] = ()
    if run["snapshot"]:
        tasks = tuple(properties_from_row(row) for row in snapshots[run["snapshot"]])
    executions = results.get(run["run_id"], pl.DataFrame(schema=frame_schema(TASK_RESULTS)))
    if executions.height != run["n_executions"] or snapshot_id(tasks) != run["snapshot"]:
        raise ValueError(f"run {run['run_id']} is not whole")
    version = Version(int(run["n_events"]), str(run["digest"]))
    return RunRecord(
        str(run["run_id"]), version, str(run["name"]), str(run["outcome"]), int(run["start_ns"]), tasks, executions
    )


def _write(path: Path, value: Any) -> None:  # noqa: ANN401 - any JSON value
    write_whole(path, f"{json.dumps(value, ensure_ascii=False, indent=1, allow_nan=False)}\n".encode())


def _read(path: Path) -> Any:  # noqa: ANN401 - any JSON value
    expected = "what hrclog kb export wrote"
    try:
        return read_json_file(path, RESULT_JSON)
    except OSError as error:
        problem = f"a file that cannot be opened ({error.strerror})"
        raise ImportDataError(path, problem, expected, _REMEDY) from error
    except ValueError as error:
        raise ImportDataError(path, f"no JSON ({error})", expected, _REMEDY) from error
