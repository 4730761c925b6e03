"""Rows of a table into executions, points in time and pauses; what cannot be read is a problem of its row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import polars as pl

from hrclog.diagnostic import Diagnostic
from hrclog.errors import HrclogError, ImportDataError
from hrclog.recorders.importers.table.columns import Bound
from hrclog.recorders.importers.table.instants import Times, TimeSettings, empty_as_null, read_times
from hrclog.recorders.importers.table.lifecycle import paired
from hrclog.recorders.importers.table.mapping import Source, TableMapping
from hrclog.recorders.importers.table.numbers import split_numbers
from hrclog.recorders.importers.table.skipped import Skip, lines_text
from hrclog.recorders.importers.table.tables import LINE
from hrclog.recorders.importers.table.time_units import AmbiguousTimesError, unit_in_name
from hrclog.recorders.importers.table.words import POINT, event_meanings, folded_words, outcome_meanings, texts_of
from hrclog.wording import counted

RUN_PARTS: Final = "run_parts"
"""Column of the values that name a run, a list."""

EXECUTIONS: Final = pl.Schema(
    {
        LINE: pl.Int64(),
        RUN_PARTS: pl.List(pl.String),
        "agent": pl.String(),
        "task": pl.String(),
        "start_ns": pl.Int64(),
        "end_ns": pl.Int64(),  # null where it was still open
        "outcome": pl.String(),  # of the vocabulary; "" where it is not told
        "not_told": pl.String(),  # the cell where the outcome is not known, though others tell theirs; else null
        "reason": pl.String(),
        "key": pl.String(),  # what tells it apart in its run, "" for nothing
        "attempt": pl.Int64(),
        "planned_start_ns": pl.Int64(),
        "planned_end_ns": pl.Int64(),
        "planned_is_relative": pl.Boolean(),
        "origin_ns": pl.Int64(),  # when the run began, where the table tells it
        "tags": pl.List(pl.String),
    }
)
_MISSING_RUN: Final = "no column may be empty that names its run"
_LONG_NS: Final = 3600 * 10**9  # a usual execution is shorter


@dataclass(frozen=True, slots=True)
class Read:
    """What the rows of a table say.

    Attributes:
        executions: of schema `EXECUTIONS`; times count from the start of the run where `is_relative`.
        points: the same columns; what happened at `start_ns`, named by `task`.
        pauses: (number of the execution, from, until or None), ns.
        is_relative: whether times count from the start of the run.
        skips: rows that were left out.
        diagnostics: what else is remarkable.
        notes: how times were read, for people.
        date_orders: dmy or mdy, as dates showed.
    """

    executions: pl.DataFrame
    points: pl.DataFrame
    pauses: Sequence[tuple[int, int, int | None]]
    is_relative: bool
    skips: list[Skip]
    diagnostics: list[Diagnostic] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    date_orders: frozenset[str] = frozenset()


def read_rows(path: Path, bound: Bound) -> Read:
    """Return what the rows of a table say.

    Raises:
        ImportDataError: a column does not hold what it is mapped to.
    """
    try:
        return _Rows(path, bound).read()
    except ImportDataError:
        raise
    except pl.exceptions.PolarsError as error:
        found = f"a column that cannot be read ({str(error).splitlines()[0]})"
        raise ImportDataError(path, found, "columns of numbers, texts or times") from error
    except HrclogError as error:
        found, _, expected = str(error).partition(", expected ")
        raise ImportDataError(path, found.replace("found ", "", 1), expected or "one meaning") from error


class _Rows:
    """The rows of one table on their way to executions."""

    def __init__(self, path: Path, bound: Bound) -> None:
        self._path = path
        self._bound = bound
        self._mapping: TableMapping = bound.mapping
        self._frame = bound.cells.frame.select(LINE)
        self._diagnostics: list[Diagnostic] = []
        self._notes: list[str] = []
        self._problems: list[pl.Series] = []
        self._date_orders: set[str] = set()

    def read(self) -> Read:
        mapping = self._mapping
        start, end = self._interval() if not mapping.is_event_form else (self._times(mapping.time, "time"), None)
        if start is None:
            raise HrclogError("found no column of the start, expected one; name it with --start")
        rows = self._rows(start, end)
        problem = pl.DataFrame(self._problems).select(pl.coalesce(pl.all())).to_series()
        skips = [Skip(line, reason) for line, reason in zip(rows[LINE], problem, strict=True) if reason is not None]
        good = rows.filter(problem.is_null())
        if mapping.is_event_form:
            folded = paired(good, event_meanings(mapping))
            executions, points = folded.executions, folded.points
            pauses, skips = folded.pauses, skips + folded.skips
            self._diagnostics += self._unknown_outcomes(executions)
        else:
            self._diagnostics += self._unknown_outcomes(good)
            is_point = good["kind"] == POINT
            executions, points, pauses = good.filter(~is_point), good.filter(is_point), []
        return Read(
            executions.select(EXECUTIONS.names()).cast(EXECUTIONS),
            points.select(EXECUTIONS.names()).cast(EXECUTIONS),
            pauses,
            start.is_relative,
            [*self._bound.cells.skips, *skips],
            self._diagnostics,
            self._notes,
            frozenset(self._date_orders),
        )

    def _interval(self) -> tuple[Times | None, Times | None]:
        mapping = self._mapping
        start = self._times(mapping.start, "start")
        end = self._times(mapping.end, "end") if mapping.end is not None else None
        if start is None or end is not None or mapping.duration is None:
            self._check_length(start, end)
            return start, end
        length = self._duration(mapping.duration)
        end_ns = start.ns + length.ns
        self._problem(length.problem)
        end = Times(end_ns, length.problem, start.is_relative, length.form, length.is_unit_sure)
        self._check_length(start, end)
        return start, end

    def _check_length(self, start: Times | None, end: Times | None) -> None:
        """Refuse whole numbers that make executions of hours, where nothing tells their unit."""
        if start is None or end is None or (start.is_unit_sure and end.is_unit_sure):
            return
        usual = (end.ns - start.ns).median()
        if isinstance(usual, int | float) and usual > _LONG_NS:
            raise AmbiguousTimesError(
                f"found times that make most executions last {usual / 10**9:,.0f} s if they are seconds, expected that "
                "their unit is told; say which it is: --unit s, ms, us or ns"
            )

    def _settings(self, unit: str = "") -> TimeSettings:
        mapping = self._mapping
        return TimeSettings(mapping.timezone, unit or mapping.unit, mapping.date_order, mapping.decimal)

    def _times(self, source: Source | None, what: str, *, needed: bool = True) -> Times | None:
        values = self._bound.values(source)
        if values is None or source is None:
            return None
        times = read_times(values.rename(source.column or what), self._settings())
        self._date_orders |= {times.date_order} - {""}
        if needed:
            self._problem(
                pl.select(
                    pl.when(times.problem.is_not_null()).then(pl.format("{}: {}", pl.lit(what), times.problem))
                ).to_series()
            )
            if times.form:
                self._notes.append(f"{what}: {times.form}")
        if times.is_relative and self._mapping.offset is not None:
            offset = self._offset()
            times = Times(times.ns - offset, times.problem, times.is_relative, times.form, times.is_unit_sure)
        return times

    def _offset(self) -> pl.Series:
        values = self._bound.values(self._mapping.offset)
        if values is None:
            return pl.zeros(self._frame.height, pl.Int64, eager=True)
        parts = split_numbers(empty_as_null(values), self._mapping.decimal)
        return (parts["whole"] * 10**9 + parts["billionths"]).fill_null(0)

    def _duration(self, source: Source) -> Times:
        values = self._bound.values(source)
        if values is None:
            raise HrclogError("found no column of the duration, expected one; name it with --duration")
        unit = unit_in_name(source.column) or self._mapping.unit or "s"
        named = values.rename("duration")
        length = read_times(named, self._settings(unit))
        if not length.is_relative:
            raise HrclogError(f"column {source.column!r}: found instants, expected durations")
        self._notes.append(f"duration: {length.form.removesuffix(' since the start of the run')}")
        is_sure = bool(unit_in_name(source.column) or self._mapping.unit) or values.dtype == pl.Duration
        is_sure = is_sure or length.form.startswith("HH")
        return Times(length.ns, length.problem, length.is_relative, length.form, is_sure)

    def _problem(self, problem: pl.Series) -> None:
        self._problems.append(problem.rename(f"{len(self._problems)}"))

    def _text(self, source: Source | None, missing: str = "") -> pl.Series:
        """Return the texts of a source; an empty cell is the problem `missing` of its row."""
        values = self._bound.values(source)
        if values is None:
            return pl.Series("text", [""], pl.String).new_from_index(0, self._frame.height)
        texts = texts_of(values)
        if missing:
            self._problem(pl.select(pl.when(texts == "").then(pl.lit(missing))).to_series())
        return texts

    def _rows(self, start: Times, end: Times | None) -> pl.DataFrame:
        mapping = self._mapping
        start_name = "time" if mapping.is_event_form else "start"
        self._problem(pl.select(pl.when(start.ns.is_null()).then(pl.lit(f"no {start_name}"))).to_series())
        end_ns = end.ns if end is not None else pl.Series("end", [None], pl.Int64).new_from_index(0, len(start.ns))
        word = folded_words(self._text(mapping.event))
        meanings = event_meanings(mapping)[0]
        kind = word.replace_strict(meanings, default="", return_dtype=pl.String)
        if not mapping.is_event_form and end is not None:
            before = (end_ns < start.ns) & (kind != POINT)
            self._problem(pl.select(pl.when(before).then(pl.lit("it ends before it starts"))).to_series())
        if mapping.is_event_form:
            unknown = pl.format("its event {} is no start and no end", word)
            self._problem(pl.select(pl.when(kind == "").then(unknown)).to_series())
        agent, task = self._text(mapping.agent, "no agent"), self._text(mapping.task, "no task")
        outcome, not_told = self._outcomes()
        planned = [self._planned(source, name) for name, source in (
            ("planned_start", mapping.planned_start), ("planned_end", mapping.planned_end)
        )]  # fmt: skip
        is_planned_relative = any(times.is_relative for times in planned if times is not None)
        return self._frame.with_columns(
            self._run_parts().alias(RUN_PARTS), agent.alias("agent"), task.alias("task"), start.ns.alias("start_ns"),
            end_ns.alias("end_ns"), outcome.alias("outcome"), not_told.alias("not_told"),
            self._text(mapping.reason).alias("reason"), self._text(mapping.execution_id).alias("key"),
            self._attempts().alias("attempt"), kind.alias("kind"), word.alias("word"),
            *(
                (pl.lit(None, pl.Int64) if times is None else times.ns).alias(name)
                for name, times in zip(("planned_start_ns", "planned_end_ns"), planned, strict=True)
            ),
            pl.lit(is_planned_relative).alias("planned_is_relative"), self._origins().alias("origin_ns"),
            self._tags().alias("tags"),
            self._pairing().alias("pairing"),
        )  # fmt: skip

    def _planned(self, source: Source | None, name: str) -> Times | None:
        times = self._times(source, name, needed=False)
        if times is None:
            return None
        lines = self._frame[LINE].filter(times.problem.is_not_null())
        if len(lines):
            rows, where = counted(len(lines), "row"), lines_text(lines.to_list())
            text = f"{name} of {rows} cannot be read and is left out: line {where}"
            self._diagnostics.append(Diagnostic("invalid_value", text, str(self._path)))
        return times

    def _origins(self) -> pl.Series:
        """Return when the run of each row began, from a column or from the one instant that was given."""
        given = self._mapping.run_start
        if not given:
            return pl.Series("origin", [None], pl.Int64).new_from_index(0, self._frame.height)
        is_column = given in self._bound.cells.frame.columns
        cells = self._bound.cells.frame[given] if is_column else pl.Series("run_start", [given], pl.String)
        times = read_times(cells, self._settings())
        if times.is_relative or (not is_column and times.ns[0] is None):
            raise HrclogError(
                f"run_start: found {given!r}, expected an instant as 2026-03-02T09:00, or a column of them"
            )
        self._notes.append(f"start of the run: {times.form}")
        return times.ns if is_column else times.ns.new_from_index(0, self._frame.height)

    def _run_parts(self) -> pl.Series:
        parts = [self._text(source, _MISSING_RUN) for source in self._mapping.run]
        columns = [part.rename(str(number)) for number, part in enumerate(parts)]
        if not columns:
            return pl.Series(RUN_PARTS, [[]], pl.List(pl.String)).new_from_index(0, self._frame.height)
        return pl.DataFrame(columns).select(pl.concat_list(pl.all())).to_series()

    def _tags(self) -> pl.Series:
        columns = [
            self._text(Source(column=name)).rename(str(number)) for number, name in enumerate(self._mapping.tag_columns)
        ]
        if not columns:
            return pl.Series("tags", [[]], pl.List(pl.String)).new_from_index(0, self._frame.height)
        return pl.DataFrame(columns).select(pl.concat_list(pl.all())).to_series()

    def _pairing(self) -> pl.Series:
        columns = [self._text(Source(column=name)).rename(name) for name in self._mapping.pair_by]
        if not columns:
            return pl.Series("pairing", [""], pl.String).new_from_index(0, self._frame.height)
        return pl.DataFrame(columns).select(pl.concat_str(pl.all(), separator="\x1f")).to_series()

    def _attempts(self) -> pl.Series:
        values = self._bound.values(self._mapping.attempt)
        if values is None:
            return pl.Series("attempt", [1], pl.Int64).new_from_index(0, self._frame.height)
        texts = empty_as_null(values)
        numbers = split_numbers(texts, self._mapping.decimal)
        good = (numbers["whole"] >= 1) & (numbers["billionths"] == 0) & (numbers["whole"] < 2**31)
        bad = self._frame[LINE].filter(texts.is_not_null() & ~good.fill_null(value=False))
        if len(bad):
            rows, where = counted(len(bad), "row"), lines_text(bad.to_list())
            text = f"attempt of {rows} is no number from 1 and counts as 1: line {where}"
            self._diagnostics.append(Diagnostic("invalid_value", text, str(self._path)))
        return pl.select(pl.when(good).then(numbers["whole"]).otherwise(1)).to_series()

    def _outcomes(self) -> tuple[pl.Series, pl.Series]:
        """Return the outcomes, and what cells of unknown meaning hold."""
        nothing = pl.Series("not_told", [None], pl.String).new_from_index(0, self._frame.height)
        values = self._bound.values(self._mapping.outcome)
        if values is None:
            return nothing.fill_null(""), nothing
        words = folded_words(values)
        outcomes = words.replace_strict(outcome_meanings(self._mapping), default="", return_dtype=pl.String)
        if (words == "").all():  # a column without a value tells no outcome, as no column does
            return nothing.fill_null(""), nothing
        shown = texts_of(values)
        return outcomes, pl.select(pl.when(outcomes == "").then(shown)).to_series()

    def _unknown_outcomes(self, executions: pl.DataFrame) -> list[Diagnostic]:
        ended = executions.filter(
            pl.col("end_ns").is_not_null() & (pl.col("kind") != POINT), pl.col("not_told").is_not_null()
        )
        diagnostics: list[Diagnostic] = []
        for (word,), rows in ended.group_by("not_told", maintain_order=True):
            executions_text, lines = counted(rows.height, "execution"), lines_text(rows[LINE].to_list())
            if word:
                how = "say what it means with --ok, --failed or --canceled"
                text = f"found the outcome {word!r} in {executions_text}, which counts as unknown; {how}: line {lines}"
                diagnostics.append(Diagnostic("unknown_outcome", text, str(self._path)))
            else:
                text = (
                    f"{executions_text} without an outcome, where others have one: it counts as unknown: line {lines}"
                )
                diagnostics.append(Diagnostic("outcome_not_told", text, str(self._path)))
        return diagnostics
