"""The mappings that are shipped: a TOML file each, chosen by its name, or by the part of it before a hyphen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from hrclog.errors import HrclogError, ImportDataError
from hrclog.recorders.importers.table.files import table_in
from hrclog.recorders.importers.table.instants import TimeSettings, read_times
from hrclog.recorders.importers.table.mapping import TableMapping
from hrclog.recorders.importers.table.mapping_file import MappingFile, parse_mapping
from hrclog.recorders.importers.table.recognition import ENDING, preset_names, preset_text
from hrclog.recorders.importers.table.tables import Grid, Table


def preset_families() -> list[str]:
    """Return what presets are chosen by: the parts of their names before a hyphen."""
    return sorted({name.partition("-")[0] for name in preset_names()})


def presets_of(name: str) -> list[MappingFile]:
    """Return the presets of a name, those of its family if it names one.

    Raises:
        HrclogError: there is none.
    """
    names = [known for known in preset_names() if known == name or known.startswith(f"{name}-")]
    if not names:
        known = ", ".join(preset_families())
        raise HrclogError(f"preset: found {name!r}, expected one of {known}, or a file of your own: --map FILE.toml")
    return [read_preset(known) for known in sorted(names, key=lambda known: (known != name, known))]


def read_preset(name: str) -> MappingFile:
    """Return a preset."""
    return parse_mapping(preset_text(name), Path(name + ENDING))


def fitting_preset(content: Grid | Table, presets: Sequence[MappingFile]) -> TableMapping | None:
    """Return the first preset that fits a file, without the columns that the file lacks and can do without."""
    for preset in presets:
        table = _fitting_table(content, preset)
        if table is not None:
            return _only_present(preset.mapping, table)
    return None


def _fitting_table(content: Grid | Table, preset: MappingFile) -> Table | None:
    if preset.n_columns:
        if isinstance(content, Table):
            return None
        table = table_in(content, (), has_header=False)
        return table if len(table.names) == preset.n_columns and _begins_with_times(table, preset.mapping) else None
    if not preset.columns or (isinstance(content, Grid) and not content.has_header(preset.columns)):
        return None
    table = table_in(content, preset.columns)
    return table if set(preset.columns) <= set(table.names) else None


def _begins_with_times(table: Table, mapping: TableMapping) -> bool:
    """Return whether the columns of start and end of a table without a header hold times."""
    for source in (mapping.start, mapping.end):
        if source is None or source.column not in table.names:
            return False
        try:
            times = read_times(table.sample[source.column], TimeSettings())
        except HrclogError:
            return False
        if times.problem.null_count() < len(times.problem) or times.ns.null_count():
            return False
    return True


def _only_present(mapping: TableMapping, table: Table) -> TableMapping:
    names = set(table.names)
    lacking = {
        name: None
        for name in ("offset", "reason", "outcome", "execution_id", "attempt")
        if (source := getattr(mapping, name)) is not None and source.column and source.column not in names
    }
    run = tuple(source for source in mapping.run if not source.column or source.column in names)
    return replace(mapping, run=run).with_sources(lacking)


def unfitting_error(path: Path, name: str, presets: Sequence[MappingFile], content: Grid | Table) -> ImportDataError:
    """Return the error of a file that no preset of a name fits."""
    table = table_in(content, presets[0].columns)
    expected = " or ".join(
        f"{preset.n_columns} columns without a header" if preset.n_columns else ", ".join(map(repr, preset.columns))
        for preset in presets
    )
    listed = ", ".join(map(repr, table.names[:40]))
    return ImportDataError(path, f"the columns {listed}", f"those of the preset {name}: {expected}")
