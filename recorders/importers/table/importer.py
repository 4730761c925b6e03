"""The importer of tables: `hrclog import table`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from hrclog.recorders.importers.importer import Foreign, Imported, Importer, Option

_SOURCES: Final = (
    ("agent", "Column of who executes; =NAME for one agent."),
    ("task", "Column of what is executed; =NAME for one task."),
    ("start", "Column of when an execution began."),
    ("end", "Column of when it ended; an empty cell was still open."),
    ("duration", "Column of how long it took, instead of --end."),
    ("event", "Column of what happened, for a row per event."),
    ("time", "Column of when it happened, beside --event."),
    ("outcome", "Column of how it ended."),
    ("reason", "Column of why it ended so."),
    ("execution_id", "Column that tells executions apart."),
    ("attempt", "Column of the number of the attempt."),
    ("planned_start", "Column of when it was to begin."),
    ("planned_end", "Column of when it was to end."),
    ("offset", "Seconds, as =SECONDS, or a column of them, to be taken off relative times."),
)
_WORDS: Final = (
    ("ok", "Outcome that means succeeded (repeatable)."),
    ("failed", "Outcome that means failed (repeatable)."),
    ("canceled", "Outcome that means canceled (repeatable)."),
    ("started", "Event that begins an execution (repeatable)."),
    ("ended", "Event that ends one (repeatable)."),
    ("paused", "Event that pauses one (repeatable)."),
    ("resumed", "Event that resumes one (repeatable)."),
    ("points", "Event that is a point in time: an annotation (repeatable)."),
)
_SETTINGS: Final = (
    ("timezone", "Zone of times without one, as Europe/Rome."),
    ("run_start", "Instant, or column of it, from which relative times count."),
    ("unit", "Unit of times that are numbers: s, ms, us, ns, or days of a spreadsheet."),
    ("date_order", "Order of dates as 03/02/2026: dmy or mdy."),
    ("delimiter", "Sign between the columns of a text file, or tab."),
    ("encoding", "Encoding of a text file, as cp1252."),
    ("decimal", "Sign of numbers: . or ,"),
    ("sheet", "Sheet of a workbook."),
    ("tiers", "Pattern of columns that each hold the tasks of one agent, named by its first group."),
)


class TableImporter(Importer):
    """Tables with a row per execution or per event."""

    name = "table"
    summary = "Import tables: CSV, TSV, JSON lines, Parquet, Arrow, XLSX."
    description = (
        "A row is an execution (--start, and --end or --duration) or an event (--event, --time). What no option names "
        "is proposed from the columns; without -o, or with --dry-run, the proposal is shown and nothing is written. "
        "Ids derive from the rows, so importing twice adds nothing."
    )
    example = "hrclog import table study.csv --run participant,trial --agent who --task step -o runs"
    options = (
        *(Option(name, text) for name, text in _SOURCES),
        Option("run", "Columns that together name the run, COL or COL,COL (repeatable).", default=(), multiple=True),
        Option("tag_column", "Column of a fact of the run (repeatable).", default=(), multiple=True),
        Option("tag", "Fact of all runs, as KEY=VALUE (repeatable).", default=(), multiple=True),
        *(Option(name, text, default=(), multiple=True) for name, text in _WORDS),
        *(Option(name, text) for name, text in _SETTINGS),
        Option("run_gap", "Begin a new run where nothing goes on for longer than this, in s.", float),
        Option("no_header", "No row names the columns: they are #1, #2, ..., and #-1 is the last.", bool, False),
        Option("preset", "Shipped mapping: boris, elan, lerobot, plansys2."),
        Option("map", "Mapping: a TOML file, or the name of a shipped one."),
        Option("save_map", "Write the mapping to a new TOML file.", Path),
    )

    def read(self, sources: Sequence[Path], **options: Any) -> Foreign:  # noqa: ANN401 - what its options hold
        """Return the runs of tables.

        Raises:
            ImportDataError: no file can be read, or a mapping does not fit.
            HrclogError: options contradict each other.
        """
        from hrclog.recorders.importers.table.reading import read_tables

        return read_tables(sources, options)

    def arguments_for(self, head: bytes, name: str) -> str | None:
        """Return what to type for a table, with the preset that is made for it."""
        from hrclog.recorders.importers.table.recognition import is_table, preset_for

        if not is_table(head, name.lower()):
            return None
        preset = preset_for(head)
        return f"--preset {preset} -o logs" if preset else "-o logs"

    def preview(self, sources: Sequence[Path], **options: Any) -> Imported:  # noqa: ANN401 - what its options hold
        """Return what would be imported; as for `read`."""
        from hrclog.recorders.importers.writing import import_files

        return import_files(self, sources, None, **options)
