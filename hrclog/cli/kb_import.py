"""What `hrclog kb import` takes in: an export of a knowledge base, or dumps of the paper authors' database."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from hrclog.analyzers.learning.ingest import Ingested, ingest_events
from hrclog.diagnostic import Diagnostic
from hrclog.errors import ImportDataError
from hrclog.events import Event, RunStarted
from hrclog.json_text import RESULT_JSON, read_json_file
from hrclog.knowledge.base import KnowledgeBase
from hrclog.knowledge.exchange import import_json, is_export
from hrclog.recorders.importers.mongo_dump import document_id, read_task_results
from hrclog.recorders.importers.mongo_outcomes import Outcomes
from hrclog.recorders.importers.mongo_runs import run_events

Method = tuple[str | None, str | None]
"""Estimator and outliers, None for what the knowledge base has."""

_RESULTS = "task_results.json"
_PROPERTIES = "task_properties.json"


def import_folder(kb: KnowledgeBase, folder: Path) -> tuple[Ingested, Method]:
    """Take in a folder, and return what became of the runs and which statistics it had.

    Raises:
        ImportDataError: the folder holds neither, or a file cannot be read.
        KnowledgeError: the database fails.
    """
    if is_export(folder):
        run_ids, statistics = import_json(kb, folder)
        method: Method = (None, None)
        if statistics and kb.statistics() is None:
            method = (statistics[0], statistics[1])
        return Ingested(run_ids["added"], run_ids["replaced"], run_ids["unchanged"]), method
    if not (folder / _RESULTS).is_file():
        expected = f"a folder with {_RESULTS}, as hrclog kb export or mongoexport writes it"
        raise ImportDataError(folder, "none", expected, "correct the path")
    rows, diagnostics = read_task_results(folder / _RESULTS)
    diagnostics += Outcomes().diagnostics((folder / _RESULTS, row) for row in rows)
    events, duplicates = _events(rows, _properties(folder / _PROPERTIES), folder / _RESULTS)
    ingested = ingest_events(kb, events)
    return replace(ingested, diagnostics=[*diagnostics, *duplicates, *ingested.diagnostics]), (None, None)


def _events(
    rows: list[dict[str, Any]], properties: list[dict[str, Any]] | None, source: Path
) -> tuple[list[Event], list[Diagnostic]]:
    """Return the events of all recipes; the same document twice counts once."""
    runs: dict[str, dict[str, dict[str, Any]]] = {}
    duplicates: list[Diagnostic] = []
    for row in rows:
        first = runs.setdefault(row["recipe"], {}).setdefault(document_id(row), row)
        if repr(first) != repr(row):
            text = f"a second, different document has the id {document_id(row)}; the first was kept"
            duplicates.append(Diagnostic("skipped_row", text, str(source)))
    events: list[Event] = []
    for recipe, documents in sorted(runs.items()):
        for seq, event in enumerate(run_events(recipe, documents.values())):
            declared = replace(event, task_properties=properties) if isinstance(event, RunStarted) else event
            events.append(replace(declared, seq=seq))
    return events, duplicates


def _properties(path: Path) -> list[dict[str, Any]] | None:
    """Return what upstream's task_properties declare, as a run would; None where the file is not there."""
    if not path.exists():
        return None
    expected = "a JSON array of task properties"
    try:
        documents = read_json_file(path, RESULT_JSON, "utf-8-sig")
    except (OSError, ValueError) as error:
        raise ImportDataError(path, f"what cannot be read ({error})", expected, "export it again") from error
    if not isinstance(documents, list) or not all(isinstance(document, Mapping) for document in documents):
        raise ImportDataError(path, "something else", expected, "export it again")
    return [
        {
            "name": document.get("name"),
            "type": document.get("type"),
            "agents": document.get("agent"),
            "targets": document.get("goal"),
        }
        for document in documents
    ]
