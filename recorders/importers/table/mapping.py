"""What the columns of a table mean: the mapping that everything else of the table import reads."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Final

from hrclog.errors import HrclogError

UNITS: Final = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1, "days": 86_400 * 10**9}
"""Units of times that are numbers, in ns; days are those of a spreadsheet."""

DATE_ORDERS: Final = ("dmy", "mdy", "ymd")
DECIMALS: Final = (".", ",")


@dataclass(frozen=True, slots=True)
class Source:
    """Where a value comes from: a column, or what a pattern finds in it, or the same text for every row.

    Attributes:
        column: its name; "" for a constant.
        constant: the text for every row.
        pattern: a regular expression whose first group is the value.
    """

    column: str = ""
    constant: str = ""
    pattern: str = ""

    def __str__(self) -> str:
        return self.column or f"={self.constant}"


@dataclass(frozen=True, slots=True)
class TableMapping:
    """What the columns of a table mean, and how its cells are read.

    A table has a row per execution (`start`, and `end` or `duration`), or a row per event (`event` and `time`).

    Attributes:
        agent: who executes.
        task: what is executed.
        start: when an execution began.
        end: when it ended; an empty cell is an execution that was still open.
        duration: how long it took, where there is no `end`.
        event: what happened, in words that begin or end an execution; beside `start`, which rows are points in time.
        time: when it happened.
        outcome: how it ended.
        reason: why it ended so.
        run: which run a row belongs to; several columns together. Without one, a file is a run.
        execution_id: what tells executions apart, and pairs events.
        attempt: which attempt it was, from 1.
        planned_start: when it was to begin.
        planned_end: when it was to end.
        offset: seconds, or a column of them, to be taken off relative times.
        tag_columns: columns that hold facts of a run.
        pair_by: further columns in which start and end of an execution agree; `NAME*` for all that begin so.
        tiers: a pattern of columns that each hold the tasks of one agent, which its first group names.
        tags: facts of every run.
        timezone: of times without a zone.
        run_start: the instant, or the column of it, from which relative times count.
        unit: of times that are numbers.
        date_order: of dates as 03/02/2026: dmy, mdy or ymd.
        run_gap_s: a new run begins where no execution goes on for longer than this.
        ok: words for succeeded.
        failed: words for failed.
        canceled: words for canceled.
        started: words of events that begin an execution.
        ended: words of events that end one.
        paused: words of events that pause one.
        resumed: words of events that resume one.
        points: words of events that are points in time; they become annotations.
        delimiter: between the columns of a text file.
        encoding: of a text file.
        decimal: sign of numbers, "." or ",".
        sheet: of a workbook.
        has_header: whether a row names the columns; without one they are #1, #2, ..., and #-1 is the last.
    """

    agent: Source | None = None
    task: Source | None = None
    start: Source | None = None
    end: Source | None = None
    duration: Source | None = None
    event: Source | None = None
    time: Source | None = None
    outcome: Source | None = None
    reason: Source | None = None
    run: tuple[Source, ...] = ()
    execution_id: Source | None = None
    attempt: Source | None = None
    planned_start: Source | None = None
    planned_end: Source | None = None
    offset: Source | None = None
    tag_columns: tuple[str, ...] = ()
    pair_by: tuple[str, ...] = ()
    tiers: str = ""
    tags: Mapping[str, str] = field(default_factory=dict)
    timezone: str = ""
    run_start: str = ""
    unit: str = ""
    date_order: str = ""
    run_gap_s: float | None = None
    ok: tuple[str, ...] = ()
    failed: tuple[str, ...] = ()
    canceled: tuple[str, ...] = ()
    started: tuple[str, ...] = ()
    ended: tuple[str, ...] = ()
    paused: tuple[str, ...] = ()
    resumed: tuple[str, ...] = ()
    points: tuple[str, ...] = ()
    delimiter: str = ""
    encoding: str = ""
    decimal: str = ""
    sheet: str = ""
    has_header: bool = True

    @property
    def is_event_form(self) -> bool:
        """Return whether a row is an event."""
        return self.time is not None

    def sources(self) -> dict[str, Source]:
        """Return the sources that are set, by what they mean; the parts of the run are run, run 2, ..."""
        single = {name: getattr(self, name) for name in SOURCE_FIELDS}
        runs = {f"run {number}" if number > 1 else "run": part for number, part in enumerate(self.run, 1)}
        return {name: source for name, source in (single | runs).items() if source is not None}

    def columns(self) -> list[str]:
        """Return the names of all columns that are read, each once; patterns of names as they are."""
        named = [source.column for source in self.sources().values() if source.column]
        return list(dict.fromkeys([*named, *self.tag_columns, *self.pair_by]))

    def with_sources(self, sources: Mapping[str, Source | None]) -> TableMapping:
        """Return the mapping with other sources, by what they mean."""
        changes: dict[str, Any] = dict(sources)
        return replace(self, **changes)

    def over(self, other: TableMapping) -> TableMapping:
        """Return `other` with whatever is set here instead."""
        default = TableMapping()
        changed = {
            spec.name: getattr(self, spec.name)
            for spec in fields(self)
            if getattr(self, spec.name) != getattr(default, spec.name)
        }
        if self.tags:
            changed["tags"] = {**other.tags, **self.tags}
        if self.start is not None or self.end is not None:  # an interval form replaces an event form, and the reverse
            changed = {"time": None, "event": None} | changed
        if self.time is not None:
            changed = {"start": None, "end": None, "duration": None} | changed
        if self.end is not None or self.duration is not None:
            changed = {"end": None, "duration": None} | changed
        return replace(other, **changed)


SOURCE_FIELDS: Final = (
    "agent",
    "task",
    "start",
    "end",
    "duration",
    "event",
    "time",
    "outcome",
    "reason",
    "execution_id",
    "attempt",
    "planned_start",
    "planned_end",
    "offset",
)
"""Fields of a mapping that name where one value comes from."""

WORD_FIELDS: Final = ("ok", "failed", "canceled", "started", "ended", "paused", "resumed", "points")
"""Fields of a mapping that list words."""


def source_of(text: str | None) -> Source | None:
    """Return what a text on the command line names: a column, or after "=" a constant."""
    if not text:
        return None
    return Source(constant=text[1:]) if text.startswith("=") else Source(column=text)


def delimiter_of(text: str) -> str:
    """Return the sign that a text names: itself, or for "tab" a tab."""
    return "\t" if text.casefold() in ("tab", "\\t") else text


def check_mapping(mapping: TableMapping) -> None:
    """Raise if a mapping cannot be used, whatever the table.

    Raises:
        HrclogError: says what was found, what is expected, and which option says it.
    """
    choices: Sequence[tuple[str, str, Sequence[str]]] = (
        ("unit", mapping.unit, tuple(UNITS)),
        ("date_order", mapping.date_order, DATE_ORDERS),
        ("decimal", mapping.decimal, DECIMALS),
    )
    for name, value, known in choices:
        if value and value not in known:
            raise HrclogError(f"{name}: found {value!r}, expected one of {', '.join(known)}")
    if len(mapping.delimiter) > 1:
        raise HrclogError(f"delimiter: found {mapping.delimiter!r}, expected one character, or tab")
    _check_form(mapping)
    for name, source in mapping.sources().items():
        _check_pattern(name, source.pattern)
    _check_pattern("tiers", mapping.tiers)


def _check_form(mapping: TableMapping) -> None:
    if mapping.is_event_form and mapping.event is None:
        raise HrclogError(
            "found --time without --event, expected both; say which column tells what happened: --event COL"
        )
    if mapping.is_event_form and mapping.start is not None:
        raise HrclogError("found --time and --start, expected rows of events or of executions; give one of them")


def _check_pattern(name: str, pattern: str) -> None:
    if not pattern:
        return
    try:
        groups = re.compile(pattern).groups
    except re.error as error:
        raise HrclogError(f"{name}: found the pattern {pattern!r} ({error}), expected a regular expression") from error
    if groups < 1:
        raise HrclogError(f"{name}: found the pattern {pattern!r} without a group, expected (...) around the value")


def missing_roles(mapping: TableMapping) -> list[str]:
    """Return what a mapping must still say before a table can be read with it."""
    missing = [] if mapping.tiers else [name for name in ("agent", "task") if getattr(mapping, name) is None]
    if mapping.is_event_form:
        return missing
    if mapping.event is not None and mapping.start is None:
        return [*missing, "time"]
    if mapping.start is None:
        missing.append("start")
    if mapping.end is None and mapping.duration is None:
        missing.append("end")
    return missing


def from_options(options: Mapping[str, Any]) -> TableMapping:
    """Return the mapping that options of the command line, or arguments of `from_table`, say.

    Args:
        options: by name; `run` and `tag_column` may list several, `tags` is a mapping.
    """
    values: dict[str, Any] = {name: str(options[name]) for name in _TEXT_FIELDS if options.get(name)}
    values |= {name: tuple(options[name]) for name in WORD_FIELDS if options.get(name)}
    values |= {name: source_of(options.get(name)) for name in SOURCE_FIELDS}
    gap = options.get("run_gap")
    return TableMapping(
        run=tuple(source for text in options.get("run") or () if (source := source_of(text))),
        tag_columns=tuple(options.get("tag_column") or ()),
        tags=dict(options.get("tags") or {}),
        run_gap_s=None if gap is None else float(gap),
        has_header=not options.get("no_header"),
        **values,
    )


_TEXT_FIELDS: Final = (
    "timezone",
    "run_start",
    "unit",
    "date_order",
    "delimiter",
    "encoding",
    "decimal",
    "sheet",
    "tiers",
)
