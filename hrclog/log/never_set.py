"""Fields that a writer never set: ROS gives them 0, which is no instant, no duration and no number of an event."""

from __future__ import annotations

from typing import Final

import polars as pl

from hrclog.diagnostic import Diagnostic
from hrclog.events import LATEST_NS, TASK_KINDS
from hrclog.log.remarks import without_remarks
from hrclog.wording import counted

_FAR_NS: Final = 30 * 86_400 * 10**9
_FAR_TEXT: Final = "30 days"
_PLANNED: Final = ("planned_start_ns", "planned_end_ns")
_BESIDE: Final = ("planned_duration_s", "planning_time_s", "path_length", "speed_scale")
_STANDS_FOR_UNSET: Final = {"time_ns": pl.col("log_time_ns"), "attempt": pl.lit(1)}
_STANDS_TEXTS: Final = {"time_ns": "time_ns as the time of receipt", "attempt": "attempt as 1"}
_STOP: Final = r"(?i)stop|halt|hold|paus|still|emergency|fault|violat|lock|brake|\b(sto|sos|ss[012])\b"
"""What names a stop in the mode of a safety function; the last are words of IEC 61800-5-2."""


def without_unset(events: pl.DataFrame) -> tuple[pl.DataFrame, list[Diagnostic]]:
    """Unset planned instants far from their event, the zeros beside them, and other zeros that no writer means.

    An event whose time is unset happened when it was received, at its log time.

    Args:
        events: an events frame.

    Returns:
        The events, and a diagnostic per file and run whose values count as unset.
    """
    if not _may_hold_unset(events):
        return events, []
    unset = _unset_values(events)
    flags = events.select("path", "run_id", "seq", **unset)
    counts = (
        flags.filter(pl.any_horizontal(unset.keys()))
        .group_by("path", "run_id", maintain_order=True)
        .agg(pl.col("seq").first(), pl.col(*unset).sum())
    )
    if counts.is_empty():
        return events, []
    cleaned = events.with_columns(
        pl.when(expression).then(_STANDS_FOR_UNSET.get(name, pl.lit(None))).otherwise(pl.col(name)).alias(name)
        for name, expression in unset.items()
    ).cast({name: events.schema[name] for name in unset})
    return cleaned, [_unset_diagnostic(row) for row in counts.iter_rows(named=True)]


def _may_hold_unset(events: pl.DataFrame) -> bool:
    """Return whether any value may have been left at 0; reading a log where none was costs little more than this."""
    # columns by themselves: on a small log each select takes as long as decoding some events
    times = events["time_ns"]
    for name in _PLANNED:
        farthest = (events[name] - times).abs().max()
        if isinstance(farthest, int) and farthest > _FAR_NS:
            return True
    if any((events[name] == 0).any() for name in ("time_ns", "planned_duration_s", "agent_time_ns")):
        return True
    return not set(events["kind"].filter(events["attempt"] == 0).unique()).isdisjoint(TASK_KINDS)


def _unset_values(events: pl.DataFrame) -> dict[str, pl.Expr]:
    """Return by column which of its values count as unset."""
    time = pl.col("time_ns")
    unset: dict[str, pl.Expr] = {}
    if "log_time_ns" in events.columns and (events["time_ns"] == 0).any():
        unset["time_ns"] = _is_unset_time()
        time = pl.when(unset["time_ns"]).then(pl.col("log_time_ns")).otherwise(time)
    is_instant = time.is_between(-LATEST_NS, LATEST_NS)
    start, end = (pl.col(name) for name in _PLANNED)
    # simulated time begins at 0, where a planned 0 is not far
    all_zero = (start == 0) & (end == 0) & (pl.col("planned_duration_s") == 0)
    for name in _PLANNED:
        if events[name].null_count() < events.height:
            planned = pl.col(name)
            far = planned.is_between(-LATEST_NS, LATEST_NS) & ((planned - time).abs() > _FAR_NS)
            unset[name] = (is_instant & (far | all_zero)).fill_null(value=False)
    planned_unset = [unset[name] for name in _PLANNED if name in unset]
    if planned_unset or (events["planned_duration_s"] == 0).any():
        # a definition with defaults leaves instants unset, and cannot do so with floats
        beside = pl.any_horizontal(*planned_unset, pl.all_horizontal(pl.col(name) == 0 for name in _BESIDE[:3]))
        unset |= {name: (beside & (pl.col(name) == 0)).fill_null(value=False) for name in _BESIDE}
        unset["speed_scale"] &= pl.col("kind") != "safety_state_changed"
    unset["agent_time_ns"] = ((pl.col("agent_time_ns") == 0) & (time.abs() > _FAR_NS)).fill_null(value=False)
    if (events["attempt"] == 0).any():
        unset["attempt"] = (pl.col("attempt") == 0) & pl.col("kind").is_in(TASK_KINDS)
    return unset


def _is_unset_time() -> pl.Expr:
    """Return which times are 0 and far from their log time, but in runs of simulated time, which begins at 0."""
    time, is_zero = pl.col("time_ns"), pl.col("time_ns") == 0
    nearest = pl.when(~is_zero).then(time.abs()).min().over("run_id")
    is_simulated = pl.when(nearest.is_null()).then(pl.len().over("run_id") == 1).otherwise(nearest <= _FAR_NS)
    return (is_zero & ~is_simulated & (pl.col("log_time_ns").abs() > _FAR_NS)).fill_null(value=False)


def _unset_diagnostic(counts: dict[str, object]) -> Diagnostic:
    numbers = {name: count for name, count in counts.items() if isinstance(count, int) and name != "seq" and count}
    columns = ", ".join(f"{name} in {counted(count, 'event')}" for name, count in numbers.items())
    why = f"0, or more than {_FAR_TEXT} from the run, as a node leaves what it never sets"
    stand = ", ".join(text for name, text in _STANDS_TEXTS.items() if name in numbers)
    text = f"{columns}: {why}; they count as unset{f' ({stand})' if stand else ''}"
    return Diagnostic("never_set", text, str(counts["path"]), str(counts["run_id"]))


def with_left_out_zero(events: pl.DataFrame) -> pl.DataFrame:
    """Return the events with the number 0 of a run where proto3 JSON left it out, as it does with every 0."""
    if not events["seq"].null_count():
        return events
    seq = pl.col("seq")
    is_left_out = seq.is_null() & ((seq.is_null().sum() == 1) & (seq == 1).any() & (seq.min() == 1)).over("run_id")
    return events.with_columns(pl.when(is_left_out).then(pl.lit(0, pl.Int64)).otherwise(seq).alias("seq"))


def with_numbers(events: pl.DataFrame) -> tuple[pl.DataFrame, list[Diagnostic]]:
    """Number the events of runs in the order of writing where some `seq` is unset, or every one is 0.

    Args:
        events: an events frame, the events of each file in the order of writing.

    Returns:
        The events, and a diagnostic per run in which every `seq` is 0: several nodes leave it unset on purpose.
    """
    always_zero = _always_zero(events)
    unset = events["run_id"].filter(events["seq"].is_null())
    if always_zero.is_empty() and unset.is_empty():
        return events, []
    is_unnumbered = pl.col("run_id").is_in(pl.concat([always_zero["run_id"], unset]).unique().implode())
    # a file is in the order of writing even where its log times are not, as a clock may be put back
    latest = pl.col("log_time_ns").fill_null(0).cum_max().over("run_id", "path")
    written = latest.rank("ordinal").over("run_id").cast(pl.Int64) - 1
    numbered = events.with_columns(pl.when(is_unnumbered).then(written).otherwise(pl.col("seq")).alias("seq"))
    return numbered, [
        Diagnostic(
            "seq_never_set",
            f"seq is 0 in all {count:,} events, so it was never set: they are in the order of time and of writing, and "
            "whether some are missing is not known",
            path,
            run_id,
        )
        for run_id, path, count in always_zero.iter_rows()
    ]


def _always_zero(events: pl.DataFrame) -> pl.DataFrame:
    """Return run, path and count of events of the runs of several events in which every `seq` is 0."""
    zeros = events["run_id"].filter(events["seq"] == 0)
    if zeros.n_unique() == zeros.len():
        return pl.DataFrame(schema={"run_id": pl.String, "path": pl.String, "len": pl.UInt32})
    several = zeros.filter(zeros.is_duplicated()).unique()
    of_run = events.filter(pl.col("run_id").is_in(several.implode()))
    return (
        without_remarks(of_run)
        .group_by("run_id", maintain_order=True)
        .agg(pl.col("path").first(), pl.len(), pl.col("seq").ne_missing(0).any().alias("counts"))
        .filter(~pl.col("counts") & (pl.col("len") > 1))
        .drop("counts")
    )


def check_speeds(events: pl.DataFrame) -> list[Diagnostic]:
    """Question speed scales of 0 beside a mode that is no stop."""
    if not (events["speed_scale"] == 0).any():
        return []
    columns = events.select("path", "run_id", "agent", "mode", "seq", "kind", "speed_scale")
    stopped = columns.filter(pl.col("speed_scale") == 0).filter(pl.col("kind") == "safety_state_changed")
    doubtful = stopped.filter((pl.col("mode") != "") & ~pl.col("mode").str.contains(_STOP))
    groups = doubtful.group_by("path", "run_id", "agent", "mode", maintain_order=True)
    return [
        Diagnostic(
            "doubtful_speed",
            f"speed_scale is 0 beside mode {mode!r} in {counted(count, 'event')} of {agent!r}: a stop, or never set? "
            "Stop times and mean speeds take it for a stop",
            path,
            run_id,
            seq,
        )
        for path, run_id, agent, mode, seq, count in groups.agg(pl.col("seq").first(), pl.len()).iter_rows()
    ]
