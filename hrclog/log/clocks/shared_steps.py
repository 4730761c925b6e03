"""Steps of a clock that all agents share: one computer's clock was put back while events were written.

Event times and log times come from that clock alike, so comparing them tells nothing. But the order of writing goes on:
where both fall against it, the clock was put back.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import polars as pl

from hrclog.diagnostic import Diagnostic
from hrclog.events import LATEST_NS
from hrclog.log.clocks.offsets import seconds_text
from hrclog.log.clocks.series import LEAST_NS, RECORDER
from hrclog.wording import counted

_NOT_WRITTEN_THEN: Final = ("clock_synced", "annotation_added")
_MOST: Final = 2  # and one of so many events; more falls are another order than that of writing
_EVENTS_PER_STEP: Final = 20
_MS: Final = 10**6


def shared_steps(events: pl.DataFrame) -> list[Diagnostic]:
    """Return where times fall against the order of writing, by run and file.

    Files of several recorders are not compared: each has a clock of its own.

    Args:
        events: an events frame in the order of run and time, with numbers in the order of writing.
    """
    falls = (events["seq"].diff() < 0).fill_null(value=False)
    if not falls.any():
        return []
    falls &= (events["run_id"] == events["run_id"].shift(1)).fill_null(value=False)
    doubtful = events["run_id"].filter(falls).unique()
    if doubtful.is_empty():
        return []
    plausible = (pl.col(name).is_between(-LATEST_NS, LATEST_NS) for name in ("time_ns", "log_time_ns"))
    written = events.filter(
        pl.col("run_id").is_in(doubtful.implode()), ~pl.col("kind").is_in(_NOT_WRITTEN_THEN), *plausible
    )
    parts = written.sort("run_id", "path", "seq").partition_by("run_id", "path", as_dict=True, maintain_order=True)
    return [_diagnostic(part, places) for part in parts.values() if (places := _places(part))]


def _places(part: pl.DataFrame) -> list[int]:
    """Return behind which events of a file the clock was put back.

    Args:
        part: events of one run in one file, in the order of writing.
    """
    if part["seq"].n_unique() < part.height:  # of several nodes that count for themselves
        return []
    if (part["time_ns"] == part["log_time_ns"]).all():  # copied by a converter, and not of the time of writing
        return []
    fell, log_fell = (-np.diff(part[name].to_numpy()) for name in ("time_ns", "log_time_ns"))
    both = np.minimum(fell, log_fell)
    places: list[int] = np.flatnonzero(
        (both > LEAST_NS) & (np.abs(fell - log_fell) <= np.maximum(both // 2, LEAST_NS))
    ).tolist()
    if len(places) > max(_MOST, part.height // _EVENTS_PER_STEP):
        return []
    agents = part["agent"].to_list()
    return [place for place in places if _goes_on(set(agents[: place + 1]), set(agents[place + 1 :]))]


def _goes_on(before: set[str], behind: set[str]) -> bool:
    """Return whether an agent has events on both sides: else agents were recorded one after the other."""
    return bool((before & behind) - {RECORDER})


def _diagnostic(part: pl.DataFrame, places: list[int]) -> Diagnostic:
    written, seq = part["log_time_ns"], part["seq"]
    sizes = [written[place] - written[place + 1] for place in places]
    place, size_ns = places[int(np.argmax(sizes))], max(sizes)
    often = "was put back" if len(places) == 1 else f"was put back {counted(len(places), 'time')}, farthest"
    size = seconds_text(round(size_ns / _MS) * _MS)[1:]
    text = (
        f"the clock that all agents share {often} by at least {size} s between seq {seq[place]} and {seq[place + 1]} "
        "(event times and log times fall against the order of writing): durations and overlaps across it are wrong; "
        "leave the run out"
    )
    return Diagnostic("clock_jump", text, part["path"][0], part["run_id"][0], seq[place + 1])
