"""What the events of a run say of the clocks of its agents: by how much event times are ahead of log times.

An event is written after it happened, by a delay that varies. So an event that is far behind its neighbours was written
late, and of events that were written together the one with the least delay says most. Where an agent's events wait and
are then written several at once, the delay of that one is not known either: its clock is ahead by at least so much.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import polars as pl

from hrclog.arrays import BoolArray, FloatArray, IntArray
from hrclog.events import LATEST_NS
from hrclog.units import NS_PER_S

RECORDER: Final = ""
"""The agent of events that name none: they carry the recorder's own time."""

LEAST_NS: Final = NS_PER_S
"""Smaller differences of clocks cannot be told from delays."""

FEW: Final = 4
"""So many batches do not tell how much delays vary; then differences below `FEW_NS` may be delays."""

FEW_NS: Final = 3 * NS_PER_S

_TOGETHER_NS: Final = 50 * 10**6
_SYNCED_NS: Final = NS_PER_S // 2  # between two events that waited
_SYNCED_PART: Final = 0.2  # of an agent's events that lie apart
_SIGMAS: Final = 4.0
_SIGMA_OF_MAD: Final = 1.4826
_NOT_ON_AGENTS_CLOCK: Final = ("clock_synced",)


@dataclass(frozen=True, slots=True)
class Series:
    """What one agent's events say of its clock, in the order of writing; arrays have shape (n,).

    `written_ns`, `time_ns` and `ahead_ns` are of batches of events that were written together: log time and event time
    of the one with the least delay, and their difference. `first` and `last` are the indices of a batch's events in
    `seq` and `execution_ids`. `span_ns` is from the first to the last event time.
    """

    agent: str
    written_ns: IntArray
    time_ns: IntArray
    ahead_ns: IntArray
    first: IntArray
    last: IntArray
    seq: IntArray
    execution_ids: list[str] = field(repr=False)
    span_ns: int
    waits: bool
    """Whether events wait and are then written several at once: at the end, or whenever there is a connection."""

    @property
    def level_ns(self) -> float:
        """Return by how much the clock is ahead of log times, the median."""
        return float(np.median(self.ahead_ns))

    @property
    def spread_ns(self) -> float:
        """Return how much single batches deviate from that, as a standard deviation."""
        return float(_SIGMA_OF_MAD * np.median(np.abs(self.ahead_ns - self.level_ns)))

    @property
    def least_ahead_ns(self) -> float:
        """Return by how much the clock is ahead at least, by the batch with the least delay but for one."""
        return float(np.sort(self.ahead_ns)[-2 if len(self.ahead_ns) > 2 else -1])

    @property
    def tells(self) -> bool:
        """Return whether event times can be compared with log times: they cannot if events waited, or do not move."""
        return not self.waits and (self.span_ns > 0 or len(self.written_ns) == 1)


def timed(events: pl.DataFrame) -> pl.DataFrame:
    """Return the events whose event time and log time can be compared, by run, agent and order of writing."""
    plausible = (pl.col(name).is_between(-LATEST_NS, LATEST_NS) for name in ("time_ns", "log_time_ns"))
    usable = events.filter(*plausible, ~pl.col("kind").is_in(_NOT_ON_AGENTS_CLOCK))
    return usable.sort("run_id", "agent", "seq", "log_time_ns", maintain_order=True)


def series_of(run_events: pl.DataFrame) -> list[Series]:
    """Return the series of one run, by agent.

    Args:
        run_events: events of one run, as `timed` gives them.
    """
    parts = run_events.partition_by("agent", as_dict=True, maintain_order=True)
    return [_series(str(agent), part) for (agent,), part in parts.items()]


def _series(agent: str, part: pl.DataFrame) -> Series:
    written, time = part["log_time_ns"].to_numpy(), part["time_ns"].to_numpy()
    begins = np.append(True, np.abs(np.diff(written)) >= _TOGETHER_NS)
    batch = np.cumsum(begins) - 1
    first = np.flatnonzero(begins)
    last = np.append(first[1:], len(written)) - 1
    ahead = time - written
    least_delay = np.lexsort((ahead, batch))[last]
    return Series(
        agent,
        written[least_delay],
        time[least_delay],
        ahead[least_delay],
        first,
        last,
        part["seq"].to_numpy(),
        part["execution_id"].to_list(),
        int(np.ptp(time)),
        _waits(time, written),
    )


def _waits(time: IntArray, written: IntArray) -> bool:
    """Return whether events that lie apart were often written at once."""
    happened, passed = np.abs(np.diff(time)), np.abs(np.diff(written))
    at_once = (happened >= LEAST_NS) & (passed <= np.minimum(happened // 4, _SYNCED_NS))
    n_at_once, n_apart = np.count_nonzero(at_once), np.count_nonzero(np.maximum(happened, passed) >= LEAST_NS)
    # a single one may be a clock that was put forward
    return bool((n_at_once > 1 and n_at_once >= _SYNCED_PART * n_apart) or n_at_once == n_apart == 1)


def tolerance_ns(*series: Series) -> float:
    """Return from which difference on the levels of series differ."""
    return max(LEAST_NS, _SIGMAS * max(one.spread_ns for one in series))


def reference(series: Sequence[Series]) -> float:
    """Return the level that most series share; of several such the one nearest to log times."""
    votes = [sum(_alike(one, other) for other in series) for one in series]
    most = max(votes, default=0)
    levels = [one.level_ns for one, count in zip(series, votes, strict=True) if count == most]
    return min(levels, key=abs, default=0.0)


def _alike(one: Series, other: Series) -> bool:
    return abs(one.level_ns - other.level_ns) <= tolerance_ns(one, other)


def keeps_pace(series: Iterable[Series]) -> bool:
    """Return whether log times pass as fast as event times: they do not if the log was written afterwards."""
    pairs = [(np.diff(one.time_ns), np.diff(one.written_ns)) for one in series]
    happened, written = (np.concatenate([np.empty(0, np.int64), *arrays]) for arrays in zip(*pairs, strict=True))
    telling = happened > 2 * NS_PER_S
    pace: FloatArray = written[telling] / happened[telling]
    enough = 5
    return len(pace) < enough or 0.67 <= float(np.median(pace)) <= 1.5


def written_at_once(run_events: pl.DataFrame) -> bool:
    """Return whether events that lie apart were written together, so that log times say nothing of clocks.

    Args:
        run_events: events of one run, as `timed` gives them.
    """
    columns = ("time_ns", "log_time_ns")
    times, written = (run_events[name].to_numpy() for name in columns)
    if np.ptp(times) < NS_PER_S or np.ptp(written) > 0.1 * np.ptp(times):
        return False
    same_agent: BoolArray = (run_events["agent"] == run_events["agent"].shift(1)).fill_null(value=False).to_numpy()
    happened, passed = np.diff(times)[same_agent[1:]], np.diff(written)[same_agent[1:]]
    apart = np.abs(happened) > NS_PER_S // 10
    return bool(np.mean(np.abs(passed[apart]) < _TOGETHER_NS) >= 0.8) if apart.any() else not np.ptp(written)
