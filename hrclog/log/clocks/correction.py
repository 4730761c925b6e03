"""Bring the times of agents whose clocks are off to the recorder's clock, by offsets that are told or were recorded."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
import polars as pl

from hrclog.arrays import IntArray
from hrclog.diagnostic import Diagnostic
from hrclog.errors import HrclogError
from hrclog.events import LATEST_NS
from hrclog.log.clocks.offsets import checked_offset, offset_text
from hrclog.log.clocks.series import LEAST_NS, RECORDER, Series, reference, series_of, timed, tolerance_ns
from hrclog.log.remarks import without_remarks
from hrclog.wording import counted

Clocks = Mapping[str, int | str]
"""By agent, how far its clock is ahead: ns, or a text such as +3600s."""

NO_CLOCKS: Final[Clocks] = {}

_SYNCED: Final = "clock_synced"


def on_one_clock(events: pl.DataFrame, clocks: Clocks = NO_CLOCKS) -> tuple[pl.DataFrame, list[Diagnostic]]:
    """Take the offsets of clocks off the times of events, and say so.

    Offsets that the caller names apply to all events of their agents. Of other agents, offsets that `clock_synced`
    events tell are taken off where event times, compared with log times, show that this was not done before.

    Args:
        events: an events frame.
        clocks: by agent, how far its clock is ahead, ns or a text.

    Raises:
        HrclogError: no event names such an agent, or an offset is none.
    """
    corrected, told = _as_told(events, clocks)
    synced, found = _as_synced(corrected, clocks)
    return synced, [*told, *found]


def _as_told(events: pl.DataFrame, clocks: Clocks) -> tuple[pl.DataFrame, list[Diagnostic]]:
    diagnostics: list[Diagnostic] = []
    for agent, offset_ns in sorted((str(agent), _offset_ns(agent, offset)) for agent, offset in clocks.items()):
        is_theirs = (pl.col("agent") == agent) & _on_agents_clock()
        count = events.filter(is_theirs).height
        if not count or not agent:
            agents = ", ".join(map(repr, sorted(set(events["agent"]) - {RECORDER}))) or "none, for no event names one"
            raise HrclogError(
                f"clock of {agent!r}: found no event of this agent, expected one of {agents}; correct the name"
            )
        events = events.with_columns(pl.when(is_theirs).then(pl.col("time_ns") - offset_ns).otherwise("time_ns"))
        diagnostics.append(_corrected(agent, offset_ns, count, "as --clock says"))
    return events, diagnostics


def _offset_ns(agent: str, offset: int | str) -> int:
    try:
        return checked_offset(offset)
    except ValueError as error:
        raise HrclogError(f"clock of {agent!r}: {error}") from error


def _on_agents_clock() -> pl.Expr:
    """Return which events carry their agent's time: the instant of a `clock_synced` is the recorder's."""
    return (pl.col("kind") != _SYNCED) & pl.col("time_ns").is_between(-LATEST_NS, LATEST_NS)


def _corrected(agent: str, offset_ns: int, count: int, why: str, path: str = "", run_id: str = "") -> Diagnostic:
    moved = counted(count, "time of its events was", "times of its events were")
    return Diagnostic(
        "clock_corrected",
        f"the clock of {agent!r} counts as {offset_text(offset_ns)} ahead, {why}: {moved} corrected by that",
        path,
        run_id,
    )


def _as_synced(events: pl.DataFrame, clocks: Clocks) -> tuple[pl.DataFrame, list[Diagnostic]]:
    if events["agent_time_ns"].null_count() == events.height:
        return events, []
    synced = events.filter(
        (pl.col("kind") == _SYNCED)
        & ~pl.col("agent").is_in([RECORDER, *clocks])
        & pl.col("agent_time_ns").is_between(-LATEST_NS, LATEST_NS)
        & pl.col("time_ns").is_between(-LATEST_NS, LATEST_NS)
    ).sort("run_id", "agent", "seq", maintain_order=True)
    if synced.is_empty():
        return events, []
    rows = events.with_row_index("row")
    comparable = timed(without_remarks(rows).filter(pl.col("run_id").is_in(synced["run_id"].unique().implode())))
    shift = np.zeros(events.height, np.int64)
    diagnostics: list[Diagnostic] = []
    for (run_id,), run_events in comparable.group_by("run_id", maintain_order=True):
        series = series_of(run_events)
        for (agent,), syncs in synced.filter(pl.col("run_id") == run_id).group_by("agent", maintain_order=True):
            theirs = run_events.filter(pl.col("agent") == agent)
            others = [one for one in series if one.agent != agent]
            if theirs.is_empty():
                continue
            offsets = _latest_offsets(syncs, theirs["seq"].to_numpy())
            moved = theirs.with_columns(time_ns=pl.col("time_ns") - pl.Series(offsets))
            if _explains(series_of(theirs)[0], series_of(moved)[0], others):
                shift[theirs["row"].to_numpy()] = offsets
                typical = int(np.median(offsets))
                path = str(theirs["path"][0])
                why = "as clock_synced says and log times show"
                diagnostics.append(_corrected(str(agent), typical, theirs.height, why, path, str(run_id)))
    if not diagnostics:
        return events, []
    return events.with_columns(time_ns=pl.col("time_ns") - pl.Series(shift)), diagnostics


def _latest_offsets(syncs: pl.DataFrame, seq: IntArray) -> IntArray:
    """Return the offset that the last synchronisation before each event told, or else the first one; shape of `seq`."""
    offsets = (syncs["agent_time_ns"] - syncs["time_ns"]).to_numpy()
    latest = np.searchsorted(syncs["seq"].to_numpy(), seq, "right") - 1
    chosen: IntArray = offsets[np.maximum(latest, 0)]
    return chosen


def _explains(told: Series, moved: Series, others: list[Series]) -> bool:
    """Return whether times are off compared with the others', and no more once their offsets are taken off."""
    expected_ns = reference([one for one in others if one.tells])
    allowed_ns = max(LEAST_NS, tolerance_ns(moved))
    if told.waits:  # what is ahead of its log time cannot have happened, and of the rest nothing is known
        return told.least_ahead_ns - expected_ns > allowed_ns >= moved.least_ahead_ns - expected_ns
    is_off = max(abs(told.level_ns - expected_ns), told.spread_ns) > allowed_ns
    return is_off and abs(moved.level_ns - expected_ns) <= allowed_ns
