"""Numbers over the time of a run: speed scale, signals, and how long two agents have worked at once."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np
import polars as pl

from hrclog.analyzers.figures.text import shorten
from hrclog.analyzers.figures.thinning import extremes, worth_drawing
from hrclog.analyzers.projections.busy import BusyTime
from hrclog.analyzers.projections.metrics import MINIMUM_DISTANCE
from hrclog.arrays import FloatArray, IntArray
from hrclog.wording import agree, counted

MAX_SERIES: Final = 24
MAX_SAMPLES: Final = 50_000

SPEED_GROUP: Final = "speed scale"
DISTANCE_GROUP: Final = "minimum distance (m)"
OVERLAP_GROUP: Final = "overlap so far (s)"

BEYOND: Final = 1e12
"""Values of this size or more stand for something else, such as "no distance known", and are not drawn."""

_JOINT_PERIOD_NS: Final = 100_000_000
_AS_SIGNAL: Final = ", as a signal"
_EQUAL: Final = 0.02  # by which speed scales may differ that tell the same
_LATE_NS: Final = 200_000_000  # by which one of them may tell of a change later than the other


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """Values over ns since the first event, shapes (n,); `step` holds a value until the next, else lines join them.

    `joint` marks what is seen in three dimensions too, `thinned` what is drawn by its lowest and highest values only;
    `notes` say what is not drawn.
    """

    group: str
    name: str
    times_ns: IntArray
    values: FloatArray
    step: bool = False
    joint: bool = False
    thinned: bool = False
    notes: tuple[str, ...] = ()


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
    return found, [f"The overlap of {counted(rest, 'further pair')} of agents is not drawn."] if rest else []


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
    names = signals["name"].unique(maintain_order=True).sort().to_list()
    places = {name: _place(name, bodies) for name in names}
    drawn = sorted(names, key=lambda name: places[name].joint)
    captions = [f"The first {max_series} of {len(drawn)} signals are drawn."] if len(drawn) > max_series else []
    found = [
        _signal(signals.filter(pl.col("name") == name), name, places[name], origin_ns, max_samples)
        for name in drawn[:max_series]
    ]
    return found, [*captions, *notes(found)]


def notes(series: Iterable[Series]) -> tuple[str, ...]:
    """Return what of the series is not drawn."""
    found = list(series)
    said = [note for one in found for note in one.notes]
    thinned = sum(one.thinned for one in found)
    if thinned:
        which = counted(thinned, "signal is thinned to its", "signals are thinned to their")
        said.append(f"{which} lowest and highest values.")
    return tuple(said)


def limits(series: Sequence[Series]) -> tuple[float, float]:
    """Return the lowest and the highest value to show: of what is held 0 and 1 while it stays between them, or 0."""
    values = np.concatenate([np.empty(0), *(one.values[np.isfinite(one.values)] for one in series)])
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    if all(one.step for one in series):
        low, high = min(low, 0.0), 1.0 if low >= 0 and high <= 1 else max(high, 0.0)
    elif low < high / 2:
        low = min(low, 0.0)
    return (low, high) if low != high else (min(low, 0.0), max(high, 0.0) or 1.0)


def without_echoes(series: Iterable[Series]) -> list[Series]:
    """Leave out the speed scales that were logged as signals too, where these tell what the events tell."""
    found = list(series)
    told = {one.name: one for one in found if one.group == SPEED_GROUP}
    return [one for one in found if not (one.group == SPEED_GROUP and _is_echo(one, told))]


def _is_echo(signal: Series, told: dict[str, Series]) -> bool:
    events = told.get(signal.name.removesuffix(_AS_SIGNAL))
    if events is None or events is signal:
        return False
    # an agent has its full speed before its first event
    held = np.append(1.0, events.values)[np.searchsorted(events.times_ns, signal.times_ns, "right")]
    changes = events.times_ns[np.diff(events.values, prepend=1.0) != 0]
    before = np.searchsorted(changes, signal.times_ns, "right")
    since = signal.times_ns - np.append(np.iinfo(np.int64).min // 2, changes)[before]
    compared = (since >= _LATE_NS) & np.isfinite(signal.values)
    return bool(compared.any() and (np.abs(signal.values - held)[compared] <= _EQUAL).all())


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
        return _Place(SPEED_GROUP, f"{agent or 'signal'}{_AS_SIGNAL}", step=True)
    if agent in bodies:
        return _Place(f"joints of {agent}", last, joint=True)
    return _Place(agent or "signals", name)


def _signal(own: pl.DataFrame, name: str, place: _Place, origin_ns: int, max_samples: int) -> Series:
    ordered = own.sort("time_ns", maintain_order=True)
    times, values = ordered["time_ns"].to_numpy() - origin_ns, ordered["value"].to_numpy()
    beyond = np.abs(values) >= BEYOND
    times, values = times[~beyond], values[~beyond]
    if place.joint:
        kept = worth_drawing(times, values[:, np.newaxis], _JOINT_PERIOD_NS)
        times, values = times[kept], values[kept]
    shown = extremes(values, max_samples)
    return Series(
        place.group,
        place.label,
        times[shown],
        values[shown],
        place.step,
        place.joint,
        thinned=len(shown) < len(values),
        notes=_beyond(name, int(beyond.sum())),
    )


def _beyond(name: str, count: int) -> tuple[str, ...]:
    which = f"{counted(count, 'sample')} of {shorten(name, 60)} beyond 1e12"
    return (f"{which} {agree(count, 'is', 'are')} not drawn.",) if count else ()


def _overlap_so_far(busy: dict[str, BusyTime], one: str, other: str, origin_ns: int) -> Series:
    a, b = busy[one], busy[other]
    knots = np.unique(np.concatenate([a.start, a.end, b.start, b.end]))
    together = np.minimum(a.within(knots[:-1], knots[1:]), b.within(knots[:-1], knots[1:]))
    name = f"{shorten(one, 30)} and {shorten(other, 30)}"
    return Series(OVERLAP_GROUP, name, knots - origin_ns, np.append(0, np.cumsum(together)) / 1e9)
