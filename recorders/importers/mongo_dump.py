"""Read MongoDB dumps of task results: the usable documents, and the problems of the others."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from hrclog.diagnostic import Diagnostic
from hrclog.errors import ImportDataError
from hrclog.recorders.importers.mongo_text import read_dump

_TEXTS: Final = ("name", "agent", "recipe")
_INSTANTS: Final = ("t_start", "t_end")
_PLANNED: Final = ("t_start_planned", "t_end_planned")
_NUMBERS: Final = (*_PLANNED, "duration_planned", "planning_time", "path_length")
_SECONDS: Final = (*_INSTANTS, *_PLANNED)
_END_OF_TIME_S: Final = 2.0**62 / 1e9  # planned instants add to the start of the run
_LONGEST_REPR: Final = 80  # characters of a strange value


def read_task_results(source: Path) -> tuple[list[dict[str, Any]], list[Diagnostic]]:
    """Return the usable documents of a dump, and the problems of the others.

    Raises:
        ImportDataError: the file is missing, not JSON, or no array of task results.
    """
    dump = read_dump(source)
    rows: list[dict[str, Any]] = []
    diagnostics = list(dump.diagnostics)
    for number, document in enumerate(dump.values):
        problem = _document_problem(document)
        if problem:
            diagnostics.append(Diagnostic("skipped_row", f"document {number}: {problem}", str(source)))
            continue
        rows.append(document)
        diagnostics += [
            Diagnostic("non_finite_value", f"document {number}: {text}; it counts as unset", str(source))
            for text in _unusable_numbers(document)
        ]
    if dump.values and not rows:
        content = f"no task result ({diagnostics[0].message})"
        remedy = "give the task_results collection, not task_durations, task_synergies or task_properties"
        raise ImportDataError(source, content, "documents with t_start and t_end", remedy)
    return rows, diagnostics


def document_id(row: Mapping[str, Any]) -> str:
    """Return an id that is unique among the documents of a recipe."""
    identity = row.get("_id")
    if isinstance(identity, dict) and "$oid" in identity:
        return str(identity["$oid"])
    return json.dumps([row["agent"], row["name"], row["t_start"], row["t_end"]])


def finite_number(row: Mapping[str, Any], name: str) -> float | None:
    """Return a finite number, or None; seconds also have to stay within int64 nanoseconds."""
    value = row.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    limit = _END_OF_TIME_S if name in _SECONDS else math.inf
    # an integer may be larger than any float
    return float(value) if abs(value) < limit and abs(value) <= sys.float_info.max else None


def _document_problem(document: Any) -> str | None:  # noqa: ANN401 - any JSON value
    if not isinstance(document, dict):
        return f"found a {type(document).__name__}, expected an object"
    for name in _TEXTS:
        if not isinstance(document.get(name), str) or not document[name]:
            return f"{name} is {_short_repr(document.get(name))}, expected a name"
    for name in _INSTANTS:
        if finite_number(document, name) is None:
            return f"{name} is {_short_repr(document.get(name))}, expected epoch seconds"
    if not 0 <= document["t_start"] <= document["t_end"] < _END_OF_TIME_S:
        return f"t_start {document['t_start']!r} and t_end {document['t_end']!r} are no interval of time"
    return None if _is_unicode(document) else "it holds half of a surrogate pair, expected Unicode"


def _unusable_numbers(document: Mapping[str, Any]) -> list[str]:
    return [
        f"{name} is {_short_repr(document[name])}, expected a number"
        for name in _NUMBERS
        if document.get(name) is not None and finite_number(document, name) is None
    ]


def _is_unicode(value: Any) -> bool:  # noqa: ANN401 - any JSON value
    try:
        json.dumps(value, ensure_ascii=False).encode()
    except UnicodeEncodeError:
        return False
    return True


def _short_repr(value: Any) -> str:  # noqa: ANN401 - any JSON value
    return repr(value)[:_LONGEST_REPR]
