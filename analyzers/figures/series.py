"""Numbers over the time of a run: speed scale, signals, and how long two agents have worked at once."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations, islice
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
"""Values of this size or more are placeholders, such as "no distance known", and are not drawn."""

_JOINT_PERIOD_NS: Final = 100_000_000
_AS_SIGNAL: Final = ", as a signal"
_EQUAL: Final = 0.02  # by which equal speed scales may differ
_LATE_NS: Final = 200_000_000  # by which one of them may report a change later than the other


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """Values over ns since the first event, shapes (n,). `step` holds each value until the next, else lines join them.

    `joint` marks a series that is also shown in three dimensions. `thinned` marks one of which only the lowest and
    highest values are drawn. `notes` say what is not drawn.
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
    """Return the speed scale of each agent that has one. The last value holds until `end_ns`."""
    rows = events.filter((pl.col("kind") == "safety_state_changed") & pl.col("speed_scale").is_not_null())
    scales = []
    for (agent,), agent_rows in rows.group_by("agent", maintain_order=True):
        times, values = agent_rows["time_ns"].to_numpy(), agent_rows["speed_scale"].to_numpy()
        times = np.append(times, max(end_ns, int(times[-1]))) - origin_ns
        scales.append(Series(SPEED_GROUP, str(agent), times, np.append(values, values[-1]), step=True))
    return scales


def overlaps_so_far(
    intervals: pl.DataFrame, origin_ns: int, max_series: int = MAX_SERIES
) -> tuple[list[Series], list[str]]:
    """Return the seconds that each pair of agents has worked at the same time so far, and what is not drawn.

    The lines are exact: they bend only where an agent starts or stops.
    """
    busy = {
        str(agent): BusyTime(agent_intervals["start_ns"].to_numpy(), agent_intervals["until_ns"].to_numpy())
        for (agent,), agent_intervals in intervals.group_by("agent", maintain_order=True)
    }
    pairs = islice(combinations(sorted(busy), 2), max_series)
    lines = [_overlap_so_far(busy, first_agent, second_agent, origin_ns) for first_agent, second_agent in pairs]
    n_left_out = len(busy) * (len(busy) - 1) // 2 - len(lines)
    return lines, [
        f"The overlap of {counted(n_left_out, 'further pair')} of agents is not drawn."
    ] if n_left_out else []


def signal_series(
    signals: pl.DataFrame,
    origin_ns: int,
    bodies: Collection[str] = (),
    max_series: int = MAX_SERIES,
    max_samples: int = MAX_SAMPLES,
) -> tuple[list[Series], list[str]]:
    """Return the logged signals, grouped by the part of their names before the "/", and what is not drawn.

    Args:
        signals: a run's samples, schema `SIGNALS`.
        origin_ns: of the series' times.
        bodies: agents whose signals, named agent/joint, are joints that are also shown in three dimensions.
        max_series: how many signals are drawn; joints come last.
        max_samples: how many samples of each signal are drawn.
    """
    names = signals["name"].unique(maintain_order=True).sort().to_list()
    places = {name: _place(name, bodies) for name in names}
    drawn = sorted(names, key=lambda name: places[name].joint)
    captions = [f"The first {max_series} of {len(drawn)} signals are drawn."] if len(drawn) > max_series else []
    lines = [
        _signal(signals.filter(pl.col("name") == name), name, places[name], origin_ns, max_samples)
        for name in drawn[:max_series]
    ]
    return lines, [*captions, *notes(lines)]


def notes(series: Iterable[Series]) -> tuple[str, ...]:
    """Return notes on the parts of the series that are not drawn."""
    all_series = list(series)
    texts = [note for line in all_series for note in line.notes]
    thinned = sum(line.thinned for line in all_series)
    if thinned:
        which = counted(thinned, "signal is thinned to its", "signals are thinned to their")
        texts.append(f"{which} lowest and highest values.")
    return tuple(texts)


def limits(series: Sequence[Series]) -> tuple[float, float]:
    """Return the lowest and the highest value to show. Steps are shown from 0, up to 1 if they stay between 0 and 1."""
    values = np.concatenate([np.empty(0), *(line.values[np.isfinite(line.values)] for line in series)])
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    if all(line.step for line in series):
        low, high = min(low, 0.0), 1.0 if low >= 0 and high <= 1 else max(high, 0.0)
    elif low < high / 2:
        low = min(low, 0.0)
    return (low, high) if low != high else (min(low, 0.0), max(high, 0.0) or 1.0)


def without_echoes(series: Iterable[Series]) -> list[Series]:
    """Return the series without the speed scales that were logged as signals and repeat what the events say."""
    all_series = list(series)
    speed_series = {line.name: line for line in all_series if line.group == SPEED_GROUP}
    return [line for line in all_series if not (line.group == SPEED_GROUP and _is_echo(line, speed_series))]


def _is_echo(signal: Series, speed_series: dict[str, Series]) -> bool:
    events = speed_series.get(signal.name.removesuffix(_AS_SIGNAL))
    if events is None or events is signal:
        return False
    # an agent has its full speed before its first event
    event_values = np.append(1.0, events.values)[np.searchsorted(events.times_ns, signal.times_ns, "right")]
    changes = events.times_ns[np.diff(events.values, prepend=1.0) != 0]
    before = np.searchsorted(changes, signal.times_ns, "right")
    since = signal.times_ns - np.append(np.iinfo(np.int64).min // 2, changes)[before]
    compared = (since >= _LATE_NS) & np.isfinite(signal.values)
    return bool(compared.any() and (np.abs(signal.values - event_values)[compared] <= _EQUAL).all())


class _Place(NamedTuple):
    """The heading under which a signal is drawn, its label, and how it is drawn."""

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


def _signal(samples: pl.DataFrame, name: str, place: _Place, origin_ns: int, max_samples: int) -> Series:
    ordered = samples.sort("time_ns", maintain_order=True)
    times, values = ordered["time_ns"].to_numpy() - origin_ns, ordered["value"].to_numpy()
    beyond = np.abs(values) >= BEYOND
    times, values = times[~beyond], values[~beyond]
    if place.joint:
        moving = worth_drawing(times, values[:, np.newaxis], _JOINT_PERIOD_NS)
        times, values = times[moving], values[moving]
    drawn = extremes(values, max_samples)
    return Series(
        place.group,
        place.label,
        times[drawn],
        values[drawn],
        place.step,
        place.joint,
        thinned=len(drawn) < len(values),
        notes=_beyond_note(name, int(beyond.sum())),
    )


def _beyond_note(name: str, count: int) -> tuple[str, ...]:
    which = f"{counted(count, 'sample')} of {shorten(name, 60)} beyond 1e12"
    return (f"{which} {agree(count, 'is', 'are')} not drawn.",) if count else ()


def _overlap_so_far(busy: dict[str, BusyTime], first_agent: str, second_agent: str, origin_ns: int) -> Series:
    a, b = busy[first_agent], busy[second_agent]
    knots = np.unique(np.concatenate([a.start, a.end, b.start, b.end]))
    together = np.minimum(a.within(knots[:-1], knots[1:]), b.within(knots[:-1], knots[1:]))
    name = f"{shorten(first_agent, 30)} and {shorten(second_agent, 30)}"
    return Series(OVERLAP_GROUP, name, knots - origin_ns, np.append(0, np.cumsum(together)) / 1e9)
