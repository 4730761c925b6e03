"""Read tables by the options of `hrclog import table`: what the columns mean, and the runs in the rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hrclog.diagnostic import Diagnostic
from hrclog.errors import HrclogError, ImportDataError
from hrclog.event_rows import from_row
from hrclog.recorders.importers.importer import Foreign, Reading
from hrclog.recorders.importers.table.columns import bind
from hrclog.recorders.importers.table.executions import read_rows
from hrclog.recorders.importers.table.files import open_file, table_in
from hrclog.recorders.importers.table.first_row import first_row_text
from hrclog.recorders.importers.table.instants import AmbiguousDatesError, check_zone
from hrclog.recorders.importers.table.mapping import (
    TableMapping,
    check_mapping,
    delimiter_of,
    from_options,
    missing_roles,
)
from hrclog.recorders.importers.table.mapping_file import mapping_text, read_mapping, write_mapping
from hrclog.recorders.importers.table.presets import (
    fitting_preset,
    presets_of,
    read_preset,
    unfitting_error,
)
from hrclog.recorders.importers.table.proposal import propose
from hrclog.recorders.importers.table.recognition import preset_names
from hrclog.recorders.importers.table.run_events import RunEvents, run_events
from hrclog.recorders.importers.table.runs import Runs, TableFile, runs_of
from hrclog.recorders.importers.table.skipped import skip_diagnostics, skip_values
from hrclog.recorders.importers.table.tables import Grid, Table
from hrclog.tags import parse_tags
from hrclog.wording import counted


@dataclass(frozen=True, slots=True)
class Proposed:
    """A file, its table, and what its columns mean."""

    path: Path
    table: Table
    mapping: TableMapping


def read_tables(sources: Sequence[Path], options: Mapping[str, Any]) -> Foreign:
    """Return the runs of tables.

    Raises:
        ImportDataError: no file can be read, or a mapping does not fit.
        HrclogError: options contradict each other.
    """
    given = from_options(_normal(options))
    check_mapping(given)
    if given.timezone:
        check_zone(given.timezone)
    files, diagnostics, mapping = _read_files(list(sources), given, options)
    save = options.get("save_map")
    if save is not None:
        write_mapping(Path(save), mapping)
    runs, events, findings = events_of(files)
    diagnostics += findings
    n_skipped = sum(map(len, runs.skips.values()))
    first = first_row_text(runs)
    reading = Reading(
        f"{counted(n_skipped, 'row')} skipped; first row read as {first}",
        "\n".join(_notes(files, mapping)),
        {
            "n_skipped": n_skipped,
            "skipped": [value for path, skips in runs.skips.items() for value in skip_values(path, skips)],
            "first_row": first,
            "mapping": mapping_text(mapping),
        },
    )
    names = [run.name for run in runs.runs.values()]
    spans = events.spans
    return Foreign(
        names,
        lambda run: [from_row(row) for row in events.frame[slice(*spans[run])].iter_rows(named=True)],
        runs.executions.height,
        diagnostics,
        columns=(events.frame, spans),
        reading=reading,
    )


def events_of(files: Sequence[TableFile]) -> tuple[Runs, RunEvents, list[Diagnostic]]:
    """Return the runs of tables, their events, and what is remarkable.

    Raises:
        ImportDataError: no row is an execution.
    """
    runs = runs_of(files)
    diagnostics = [finding for path, skips in runs.skips.items() for finding in skip_diagnostics(path, skips)]
    diagnostics += [*(note for file in files for note in file.read.diagnostics), *runs.diagnostics]
    if not runs.runs:
        raise _nothing_left(files[0].path, diagnostics)
    return runs, run_events(runs), diagnostics


def with_proposal(table: Table, given: TableMapping) -> TableMapping:
    """Return a mapping of a table that says all that is needed: what is given, and what the columns suggest.

    Raises:
        ImportDataError: what the columns mean is not plain.
    """
    return propose(table, given) if missing_roles(given) else given


def _normal(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return options with their texts as a mapping takes them."""
    return {
        **options,
        "tags": parse_tags(options.get("tag") or ()),
        "delimiter": delimiter_of(str(options.get("delimiter") or "")),
    }


def _read_files(
    sources: list[Path], given: TableMapping, options: Mapping[str, Any]
) -> tuple[list[TableFile], list[Diagnostic], TableMapping]:
    """Return what the files hold, in their order; one that cannot be read hides no other.

    Dates in which day and month cannot be told apart are read as those of the other files show.
    """
    paths = list(dict.fromkeys(sources))
    results = {path: _read_file(path, given, options) for path in paths}
    orders = {
        order for result in results.values() if isinstance(result, _Read) for order in result.file.read.date_orders
    }
    if len(orders) == 1 and not given.date_order:
        (order,) = orders
        for path, result in results.items():
            if _lacks_date_order(result):
                results[path] = _read_file(path, replace(given, date_order=order), options)
    readings = [result for result in results.values() if isinstance(result, _Read)]
    failures = [result for result in results.values() if isinstance(result, ImportDataError)]
    if not readings:
        raise failures[0]
    diagnostics = [Diagnostic("unreadable_file", error.reason, str(error.path)) for error in failures]
    return [reading.file for reading in readings], diagnostics, readings[0].mapping


def _lacks_date_order(result: _Read | ImportDataError) -> bool:
    cause: BaseException | None = result if isinstance(result, ImportDataError) else None
    while cause is not None and not isinstance(cause, AmbiguousDatesError):
        cause = cause.__cause__
    return cause is not None


@dataclass(frozen=True, slots=True)
class _Read:
    """A file that was read, and what its columns mean."""

    file: TableFile
    mapping: TableMapping


def _read_file(path: Path, given: TableMapping, options: Mapping[str, Any]) -> _Read | ImportDataError:
    """Return what a file holds, or why it cannot be read."""
    try:
        proposed = propose_for(path, given, options)
        bound = bind(proposed.table, proposed.mapping)
        read = read_rows(path, bound)
    except ImportDataError as error:
        return error
    notes = [*([f"{path.name}: {proposed.table.note}"] if proposed.table.note else []), *read.notes]
    return _Read(TableFile(path, bound.mapping, replace(read, notes=notes)), proposed.mapping)


def propose_for(path: Path, given: TableMapping, options: Mapping[str, Any]) -> Proposed:
    """Return what a file's columns mean: as given, as a preset or a mapping file says, or as they suggest themselves.

    Raises:
        ImportDataError: the file cannot be read, or what its columns mean is not plain.
    """
    named = _named_mapping(options)
    reading = given.over(named[0].mapping) if named and len(named) == 1 else given
    content = open_file(path, reading)
    if named:
        mapping = given.over(_chosen(path, content, named, str(options.get("preset") or options.get("map"))))
    elif given == TableMapping() or missing_roles(given):
        preset = fitting_preset(content, [read_preset(name) for name in preset_names()])
        mapping = given.over(preset) if preset else given
    else:
        mapping = given
    known = [name for name in mapping.columns() if not name.startswith("#")]
    table = table_in(content, known, has_header=mapping.has_header)
    return Proposed(path, table, with_proposal(table, mapping))


def _named_mapping(options: Mapping[str, Any]) -> list[Any]:
    preset, file = options.get("preset"), options.get("map")
    if preset and file:
        raise HrclogError("found --preset and --map, expected one of them")
    if preset:
        return presets_of(preset)
    if not file:
        return []
    if Path(file).exists() or Path(file).suffix:
        return [read_mapping(Path(file))]
    return presets_of(file)


def _chosen(path: Path, content: Grid | Table, named: Sequence[Any], name: str) -> TableMapping:
    if len(named) == 1 and not (named[0].columns or named[0].n_columns):
        mapping: TableMapping = named[0].mapping
        return mapping
    fitting = fitting_preset(content, named)
    if fitting is None:
        raise unfitting_error(path, name, named, content)
    return fitting


def _notes(files: Sequence[TableFile], mapping: TableMapping) -> list[str]:
    """Return how the tables were read: the columns, the form of times, and what was assumed."""
    columns = ", ".join(f"{name} = {source}" for name, source in mapping.sources().items())
    tags = f", tags = {', '.join(mapping.tag_columns)}" if mapping.tag_columns else ""
    tags += f", tiers = {mapping.tiers}" if mapping.tiers else ""
    notes = dict.fromkeys(note for file in files for note in file.read.notes)
    return [f"columns: {columns}{tags}", *notes]


def _nothing_left(path: Path, diagnostics: Sequence[Diagnostic]) -> ImportDataError:
    reason = next((finding.message for finding in diagnostics if finding.code == "skipped_row"), "no row")
    return ImportDataError(path, f"no row that is an execution ({reason})", "at least one", "name other columns")
