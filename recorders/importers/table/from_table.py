"""Tables in memory into events: what `hrclog.analyze` takes, without a file between."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import polars as pl

from hrclog.errors import HrclogError
from hrclog.event_rows import parse_details
from hrclog.log.logs import ORDER, Logs
from hrclog.log.messages.decode import EVENT_COLUMNS
from hrclog.log.messages.message import EVENTS
from hrclog.log.messages.signals import SIGNAL_COLUMNS
from hrclog.recorders.importers.table.columns import bind
from hrclog.recorders.importers.table.executions import read_rows
from hrclog.recorders.importers.table.frames import as_polars
from hrclog.recorders.importers.table.importer import TableImporter
from hrclog.recorders.importers.table.mapping import SOURCE_FIELDS, check_mapping, from_options
from hrclog.recorders.importers.table.reading import events_of, with_proposal
from hrclog.recorders.importers.table.runs import TableFile
from hrclog.recorders.importers.table.tables import table_of_frame
from hrclog.recorders.importers.writing import write_packed_logs
from hrclog.tags import checked_tags

_NAME: Final = "table"
_FILES: Final = {"preset", "map", "save_map", "tag", "no_header", "delimiter", "encoding", "sheet"}
_OPTIONS: Final = {option.name for option in TableImporter.options} - _FILES
_WORDS: Final = ("ok", "failed", "canceled", "started", "ended", "paused", "resumed", "points", "run", "tag_column")


def from_table(
    frame: Any,  # noqa: ANN401 - polars, pandas, pyarrow, and whatever else narwhals knows
    *,
    agent: str | None = None,
    task: str | None = None,
    start: str | None = None,
    end: str | None = None,
    run: str | Sequence[str] = (),
    tags: Mapping[str, str] | None = None,
    **options: Any,  # noqa: ANN401 - those of `hrclog import table`
) -> Logs:
    """Return the runs of a table, as `hrclog.analyze` takes them.

    What is not given is proposed from the columns, as `hrclog import table` does.

    Args:
        frame: of polars, pandas, pyarrow, duckdb or any other library that narwhals knows, eager or lazy; a row per
            execution or per event. Levels of an index that have names are columns.
        agent: column of who executes; "=robot" for the same in all rows.
        task: column of what is executed.
        start: column of when an execution began.
        end: column of when it ended.
        run: columns that together name the run.
        tags: facts of every run.
        options: the other options of `hrclog import table`, with `_` for `-`: outcome="result", ok=["yes"],
            tag_column=["condition"], timezone="Europe/Rome".

    Raises:
        HrclogError: `frame` is no table, an option is not known, or what the columns mean is not plain.
    """
    given = {"agent": agent, "task": task, "start": start, "end": end, "run": run} | options
    given["tags"] = checked_tags(tags)
    unknown = [name for name in options if name not in _OPTIONS]
    if unknown:
        raise HrclogError(f"from_table: found the option {unknown[0]!r}, expected one of {', '.join(sorted(_OPTIONS))}")
    for name in SOURCE_FIELDS:
        if given.get(name) is not None and not isinstance(given[name], str):
            raise HrclogError(f"from_table: {name} is {given[name]!r}, expected the name of a column")
    listed = {name: [value] if isinstance(value, str) else value for name, value in given.items() if name in _WORDS}
    mapping = from_options(given | listed)
    check_mapping(mapping)
    table = table_of_frame(Path(_NAME), as_polars(frame))
    bound = bind(table, with_proposal(table, mapping))
    runs, events, diagnostics = events_of([TableFile(table.path, bound.mapping, read_rows(table.path, bound))])
    names = {each.run_id: each.name for each in runs.runs.values()}
    path = pl.col("run_id").replace_strict(names, return_dtype=pl.String)
    columns = events.frame.with_columns(pl.col("time_ns").alias("log_time_ns"), path.alias("path"))
    return Logs(columns.select(EVENTS.names()).cast(EVENTS).sort(ORDER), SIGNAL_COLUMNS.to_frame(), diagnostics)


def write_logs(runs: Logs, folder: str | Path) -> list[Path]:
    """Write one log per run, and return their paths; a run whose log is there already is not written again.

    Args:
        runs: of `from_table`, or of `read_logs`; their events, without signals.
        folder: where the logs go.

    Raises:
        ImportDataError: a log is there that says something else.
        OutputError: the folder cannot be made.
    """
    events = runs.events.select(EVENT_COLUMNS.names()).sort("run_id", "seq", maintain_order=True)
    names = events.group_by("run_id", maintain_order=True).agg(pl.len())
    ends = names["len"].cum_sum().to_list()
    spans = dict(zip(names["run_id"], zip([0, *ends[:-1]], ends, strict=True), strict=True))
    return write_packed_logs(events, spans, _names(runs), Path(folder))


def _names(runs: Logs) -> dict[str, str]:
    started = runs.events.filter(pl.col("kind") == "run_started")
    return {
        run_id: str(parse_details(details).get("name") or run_id)
        for run_id, details in started.select("run_id", "details").iter_rows()
    }
