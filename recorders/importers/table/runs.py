"""Executions of several files into runs: their names, their ids, when they began, and their tags."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import polars as pl

from hrclog.diagnostic import Diagnostic
from hrclog.events import LATEST_NS
from hrclog.ids import derived_id
from hrclog.recorders.importers.table.executions import EXECUTIONS, RUN_PARTS, Read
from hrclog.recorders.importers.table.mapping import TableMapping
from hrclog.recorders.importers.table.skipped import Skip, lines_text
from hrclog.recorders.importers.table.tables import LINE
from hrclog.wording import counted

SOURCE: Final = "table"
RUN: Final = "run"
FILE: Final = "file"
NUMBER: Final = "number"
SEPARATOR: Final = "\x1f"

_SAME: Final = [name for name in EXECUTIONS.names() if name not in (LINE, RUN_PARTS)]


@dataclass(frozen=True, slots=True)
class TableFile:
    """A file, the mapping that it was read with, and what its rows say."""

    path: Path
    mapping: TableMapping
    read: Read


@dataclass(frozen=True, slots=True)
class Run:
    """A run: its name, its id and its facts."""

    name: str
    run_id: str
    tags: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Runs:
    """All runs and their executions.

    Attributes:
        runs: by their keys, in the order of their names.
        executions: of schema `EXECUTIONS` with the columns `RUN`, the key, and `FILE`, the number; times since 1970.
        points: the same columns.
        pauses: execution (`FILE`, `NUMBER`) and instants of pauses.
        skips: rows that were left out, by file.
        diagnostics: what else is remarkable.
    """

    runs: Mapping[str, Run]
    executions: pl.DataFrame
    points: pl.DataFrame
    pauses: pl.DataFrame
    skips: Mapping[Path, list[Skip]]
    diagnostics: Sequence[Diagnostic]


_PAUSES: Final = pl.Schema({FILE: pl.Int64, NUMBER: pl.Int64, "pause_ns": pl.Int64, "resume_ns": pl.Int64})


def runs_of(files: Sequence[TableFile]) -> Runs:
    """Return the runs that files hold together."""
    stems = _stems([file.path for file in files])
    executions = pl.concat(
        [_keyed(file.read.executions, number, file, stems[number]) for number, file in enumerate(files)]
    )
    points = pl.concat([_keyed(file.read.points, number, file, stems[number]) for number, file in enumerate(files)])
    skips = {file.path: list(file.read.skips) for file in files}
    executions, doubles = _without_doubles(executions)
    executions, points = _with_gaps(executions, points, files)
    origins = _origins(executions, points)
    executions, points = (_since_1970(frame, origins) for frame in (executions, points))
    executions, outside = _within_time(executions)
    for file, line, reason in [*doubles, *outside]:
        skips[files[file].path].append(Skip(line, reason))
    pauses = pl.concat([_pauses(file.read, number) for number, file in enumerate(files)])
    pauses = _since_1970_pauses(pauses, executions, origins)
    runs, tag_notes = _runs(executions, files)
    points = points.filter(pl.col(RUN).is_in(list(runs)))
    return Runs(
        runs,
        executions,
        points,
        pauses,
        skips,
        [*tag_notes, *_beginnings(origins, files), *_overlaps(executions, files)],
    )


def _stems(paths: Sequence[Path]) -> list[str]:
    """Return the names of files without their endings, with their folders where they would be the same."""
    stems = [path.stem for path in paths]
    return [
        f"{path.absolute().parent.name}_{stem}" if stems.count(stem) > 1 else stem
        for path, stem in zip(paths, stems, strict=True)
    ]


def _keyed(frame: pl.DataFrame, number: int, file: TableFile, stem: str) -> pl.DataFrame:
    key = pl.col(RUN_PARTS).list.join(SEPARATOR) if file.mapping.run else pl.lit(stem)
    return frame.with_row_index(NUMBER).with_columns(
        pl.col(NUMBER).cast(pl.Int64), key.alias(RUN), pl.lit(number, pl.Int64).alias(FILE),
        pl.lit(file.read.is_relative).alias("is_relative"),
    )  # fmt: skip


def _without_doubles(executions: pl.DataFrame) -> tuple[pl.DataFrame, list[tuple[int, int, str]]]:
    """Leave out rows that repeat another, and rows whose id is another's."""
    whole = executions.with_columns(pl.col("tags").list.join(SEPARATOR))
    repeats = ~whole.select(pl.struct(RUN, *_SAME).is_first_distinct()).to_series()
    named = (executions["key"] != "") & ~repeats
    own_number = pl.when(~pl.lit(named)).then(pl.col(NUMBER))  # rows without an id are all different
    is_first = pl.struct(RUN, "key", "attempt", own_number).is_first_distinct()
    taken = named & ~whole.select(is_first).to_series()
    skipped = [
        (file, line, "it repeats another row") for file, line in executions.filter(repeats).select(FILE, LINE).rows()
    ]
    skipped += [
        (file, line, "another row of its run has its execution id")
        for file, line in executions.filter(taken).select(FILE, LINE).rows()
    ]
    return executions.filter(~(repeats | taken)), skipped


def _with_gaps(
    executions: pl.DataFrame, points: pl.DataFrame, files: Sequence[TableFile]
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Number the parts of runs between which nothing goes on for longer than the gap of their mapping."""
    gaps = {number: file.mapping.run_gap_s for number, file in enumerate(files) if file.mapping.run_gap_s is not None}
    if not gaps:
        return executions, points
    rows = pl.concat(
        [frame.with_columns(pl.lit(kind).alias("is_point")) for frame, kind in ((executions, False), (points, True))]
    )
    gap_ns = pl.col(FILE).replace_strict(gaps, default=None, return_dtype=pl.Float64) * 10**9
    last = pl.max_horizontal("start_ns", pl.col("end_ns").fill_null(0)).cum_max().shift(1).over(RUN)
    ordered = rows.sort("start_ns", "end_ns", maintain_order=True)
    part = (pl.col("start_ns") - last > gap_ns).fill_null(value=False).cast(pl.Int64).cum_sum().over(RUN) + 1
    numbered = ordered.with_columns(part.alias("part"))
    several = pl.col("part").max().over(RUN) > 1
    name = pl.when(several).then(pl.format("{}_{}", RUN, "part")).otherwise(RUN)
    parts = numbered.with_columns(name.alias(RUN)).sort(FILE, NUMBER)
    is_point = parts["is_point"]
    own = parts.select(executions.columns)
    return own.filter(~is_point), own.filter(is_point)


def _origins(executions: pl.DataFrame, points: pl.DataFrame) -> pl.DataFrame:
    """Return when each run began, ns since 1970: as told, else its first start, else 1970."""
    told = pl.concat([executions, points]).group_by(RUN, maintain_order=True).agg(
        pl.col("origin_ns").drop_nulls().first().alias("told_ns"),
        pl.col("start_ns").filter(~pl.col("is_relative")).min().alias("first_ns"),
    )  # fmt: skip
    return told.select(
        RUN, pl.coalesce("told_ns", "first_ns", pl.lit(0)).alias("origin"),
        (pl.col("told_ns").is_null() & pl.col("first_ns").is_null()).alias("untold"),
    )  # fmt: skip


def _since_1970(frame: pl.DataFrame, origins: pl.DataFrame) -> pl.DataFrame:
    joined = frame.join(origins, on=RUN, how="left", maintain_order="left")
    shift = pl.when("is_relative").then(pl.col("origin")).otherwise(0)
    planned_shift = pl.when("planned_is_relative").then(pl.col("origin")).otherwise(0)
    return joined.with_columns(
        *(pl.col(name) + shift for name in ("start_ns", "end_ns")),
        *(pl.col(name) + planned_shift for name in ("planned_start_ns", "planned_end_ns")),
    ).drop("origin", "untold")


def _within_time(executions: pl.DataFrame) -> tuple[pl.DataFrame, list[tuple[int, int, str]]]:
    latest = pl.max_horizontal("start_ns", "end_ns")
    good = executions.select(((pl.col("start_ns") >= 0) & (latest <= LATEST_NS)).alias("good")).to_series()
    reason = "its time is not between 1970 and 2043"
    return executions.filter(good), [
        (file, line, reason) for file, line in executions.filter(~good).select(FILE, LINE).rows()
    ]


def _pauses(read: Read, number: int) -> pl.DataFrame:
    rows = [(number, execution, since, until) for execution, since, until in read.pauses]
    return pl.DataFrame(rows, schema=_PAUSES, orient="row")


def _since_1970_pauses(pauses: pl.DataFrame, executions: pl.DataFrame, origins: pl.DataFrame) -> pl.DataFrame:
    of_execution = executions.select(FILE, NUMBER, RUN, "is_relative").join(origins, on=RUN, how="left")
    joined = pauses.join(of_execution, on=[FILE, NUMBER], how="inner", maintain_order="left")
    shift = pl.when("is_relative").then(pl.col("origin")).otherwise(0)
    return joined.select(FILE, NUMBER, pl.col("pause_ns") + shift, pl.col("resume_ns") + shift)


def _runs(executions: pl.DataFrame, files: Sequence[TableFile]) -> tuple[dict[str, Run], list[Diagnostic]]:
    """Return the runs by key, in order of their names, and which tags have several values in a run."""
    diagnostics: list[Diagnostic] = []
    groups = executions.group_by(RUN, maintain_order=True).agg(
        pl.col(FILE).first(), pl.struct(FILE, "tags").unique(maintain_order=True).alias("values")
    )
    names = _names(groups[RUN].to_list())
    runs: dict[str, Run] = {}
    for key, file, values in groups.rows():
        tags, several = _tags(files, values)
        tags = {**dict(files[file].mapping.tags), **tags}
        for name, texts in several.items():
            shown = ", ".join(map(repr, texts[:5]))
            text = f"tag {name!r} is {shown} in run {names[key]!r}, expected one value; it is left out"
            diagnostics.append(Diagnostic("invalid_value", text, str(files[file].path)))
        runs[key] = Run(names[key], derived_id(SOURCE, *key.split(SEPARATOR)), tags)
    return dict(sorted(runs.items(), key=lambda item: item[1].name)), diagnostics


def _tags(
    files: Sequence[TableFile], values: Sequence[Mapping[str, object]]
) -> tuple[dict[str, str], dict[str, list[str]]]:
    """Return the tags of a run, and those that have several values in it."""
    texts: dict[str, dict[str, None]] = {}
    for entry in values:
        columns = files[int(str(entry[FILE]))].mapping.tag_columns
        row_tags = entry["tags"]
        for name, text in zip(columns, row_tags if isinstance(row_tags, list) else [], strict=True):
            if text:
                texts.setdefault(name, {})[text] = None
    single = {name: next(iter(found)) for name, found in texts.items() if len(found) == 1}
    return single, {name: list(found) for name, found in texts.items() if len(found) > 1}


def _names(keys: Sequence[str]) -> dict[str, str]:
    """Return readable names of runs, the parts of their keys joined; names that would be the same get a hash."""
    joined = {key: "_".join(key.split(SEPARATOR)) for key in keys}
    counts: dict[str, int] = {}
    for name in joined.values():
        counts[name] = counts.get(name, 0) + 1
    return {
        key: name if counts[name] == 1 else f"{name}_{derived_id(SOURCE, *key.split(SEPARATOR))[:8]}"
        for key, name in joined.items()
    }


def _beginnings(origins: pl.DataFrame, files: Sequence[TableFile]) -> list[Diagnostic]:
    n_untold = int(origins["untold"].sum())
    if not n_untold:
        return []
    text = (
        f"times count from the start of the run, and nothing tells when {counted(n_untold, 'run')} began: they begin "
        "in 1970; say when with --run-start INSTANT or COL"
    )
    return [Diagnostic("no_run_start", text, str(files[0].path))]


def _overlaps(executions: pl.DataFrame, files: Sequence[TableFile]) -> list[Diagnostic]:
    """Return which rows begin before their agent ended what it did before."""
    ordered = executions.sort(RUN, "agent", "start_ns", "end_ns", maintain_order=True)
    last = pl.col("end_ns").cum_max().shift(1).over(RUN, "agent")
    overlapping = ordered.filter(pl.col("start_ns") < last)
    return [
        Diagnostic(
            "self_overlap",
            f"{agent!r} begins {counted(rows.height, 'execution')} before its last has ended: line "
            f"{lines_text(rows[LINE].to_list())}",
            str(files[int(str(file))].path),
        )
        for (file, agent), rows in overlapping.group_by(FILE, "agent", maintain_order=True)
    ]
