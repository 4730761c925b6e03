"""Numbers over the time of a run: speed scale, signals, and how long two agents have worked at once."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np
import polars as pl

from hrclog.analyzers.busy import BusyTime
from hrclog.analyzers.figures.arrays import FloatArray, IntArray
from hrclog.analyzers.figures.text import shorten
from hrclog.analyzers.figures.thinning import worth_drawing
from hrclog.analyzers.metrics import MINIMUM_DISTANCE

MAX_SERIES: Final = 24
MAX_SAMPLES: Final = 50_000

SPEED_GROUP: Final = "speed scale"
DISTANCE_GROUP: Final = "minimum distance (m)"
OVERLAP_GROUP: Final = "overlap so far (s)"

_JOINT_PERIOD_NS: Final = 100_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """Values over ns since the first event, shapes (n,); `step` holds a value until the next, else lines join them.

    `joint` marks what is seen in three dimensions too.
    """

    group: str
    name: str
    times_ns: IntArray
    values: FloatArray
    step: bool = False
    joint: bool = False


def speed_scales(events: pl.DataFrame, origin_ns: int, end_ns: int) -> list[Series]:
    """Return the speed scale of each agent that has one, held until `end_ns`."""
    rows = events.filter((pl.col("kind") == "safety_state_changed") & pl.col("speed_scale").is_not_null())
    found = []
    for (agent,), own in rows.group_by("agent", maintain_order=True):
        times, values = own["time_ns"].to_numpy(), own["speed_scale"].to_numpy()
        times = np.append(times, max(end_ns, int(times[-1]))) - origin_ns
        found.append(Series(SPEED_GROUP, str(agent), times, np.append(values, values[-1]), step=True))
    return found


def overlaps_so_far(
    intervals: pl.DataFrame, origin_ns: int, max_series: int = MAX_SERIES
) -> tuple[list[Series], list[str]]:
    """Return the seconds that each pair of agents has worked at once so far, and what is not drawn.

    The lines are exact: they bend only where an agent starts or stops.
    """
    busy = {
        str(agent): BusyTime(own["start_ns"].to_numpy(), own["until_ns"].to_numpy())
        for (agent,), own in intervals.group_by("agent", maintain_order=True)
    }
    pairs = list(combinations(sorted(busy), 2))
    found = [_overlap_so_far(busy, one, other, origin_ns) for one, other in pairs[:max_series]]
    rest = len(pairs) - len(found)
    return found, [f"The overlap of {rest} further pairs of agents is not drawn."] if rest else []


def signal_series(
    signals: pl.DataFrame,
    origin_ns: int,
    bodies: Collection[str] = (),
    max_series: int = MAX_SERIES,
    max_samples: int = MAX_SAMPLES,
) -> tuple[list[Series], list[str]]:
    """Return the logged signals, grouped by what stands before the "/" in their names, and what is not drawn.

    Args:
        signals: a run's samples, schema `SIGNALS`.
        origin_ns: of the series' times.
        bodies: agents whose signals, named agent/joint, are joints that are seen in three dimensions too.
        max_series: how many are drawn, joints last.
        max_samples: how many samples of each.
    """
    captions = []
    thinned = 0
    names = signals["name"].unique(maintain_order=True).sort().to_list()
    places = {name: _place(name, bodies) for name in names}
    drawn = sorted(names, key=lambda name: places[name].joint)
    if len(drawn) > max_series:
        captions.append(f"The first {max_series} of {len(drawn)} signals are drawn.")
    found: list[Series] = []
    for name in drawn[:max_series]:
        own = signals.filter(pl.col("name") == name).sort("time_ns", maintain_order=True)
        place = places[name]
        if place.joint:
            own = own[worth_drawing(own["time_ns"].to_numpy(), own.select("value").to_numpy(), _JOINT_PERIOD_NS)]
        every = -(-own.height // max_samples)
        thinned += every > 1
        own = own.gather_every(every)
        times, values = own["time_ns"].to_numpy() - origin_ns, own["value"].to_numpy()
        found.append(Series(place.group, place.label, times, values, place.step, place.joint))
    if thinned:
        captions.append(f"{thinned} signals are thinned to at most {max_samples:,} samples each.")
    return found, captions


class _Place(NamedTuple):
    """Under which heading a signal is drawn, and how."""

    group: str
    label: str
    step: bool = False
    joint: bool = False


def _place(name: str, bodies: Collection[str]) -> _Place:
    agent, _, last = name.rpartition("/")
    if last == MINIMUM_DISTANCE:
        return _Place(DISTANCE_GROUP, agent or "human and robot")
    if last == "speed_scale":
        return _Place(SPEED_GROUP, f"{agent or 'signal'}, as a signal", step=True)
    if agent in bodies:
        return _Place(f"joints of {agent}", last, joint=True)
    return _Place(agent or "signals", name)


def _overlap_so_far(busy: dict[str, BusyTime], one: str, other: str, origin_ns: int) -> Series:
    a, b = busy[one], busy[other]
    knots = np.unique(np.concatenate([a.start, a.end, b.start, b.end]))
    together = np.minimum(a.within(knots[:-1], knots[1:]), b.within(knots[:-1], knots[1:]))
    name = f"{shorten(one, 30)} and {shorten(other, 30)}"
    return Series(OVERLAP_GROUP, name, knots - origin_ns, np.append(0, np.cumsum(together)) / 1e9)
