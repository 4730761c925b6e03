"""Estimates over the number of runs: a line each in a pale band, named at its right end, both axes logarithmic."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Final

import numpy as np

from hrclog.analyzers.figures.palette import LINES, Color
from hrclog.analyzers.figures.plot import WIDE, Axis, Band, Dot, Plot, Stroke, Text
from hrclog.arrays import FloatArray

MAX_CURVES: Final = 8

_HEIGHT: Final = 420
_NAMES: Final = 0.36  # of the area, for the names at the right
_LINE_PX: Final = 20
_FURTHEST: Final = 3.0  # times the values, as far as a last interval may widen the axis
_FURTHER: Final = 1.5  # the same of the intervals before
_FEWEST_TICKS: Final = 4
_MOST_TICKS: Final = 12
_LEAST_SPAN: Final = 1e-300  # of steps of which all are powers of ten that a float64 holds
_TICK_PX: Final = 44


@dataclass(frozen=True, slots=True)
class Knot:
    """An estimate after a number of runs: a value above 0, the ends of its interval if there is one, and a label."""

    runs: int
    value: float
    low: float | None
    high: float | None
    label: str


@dataclass(frozen=True, slots=True)
class Curve:
    """A name, and one knot per step, None where nothing is known. The last knot is never None."""

    name: str
    knots: tuple[Knot | None, ...]

    @property
    def last(self) -> Knot:
        """Return the estimate after all runs."""
        last = self.knots[-1]
        assert last is not None  # noqa: S101 - see above
        return last


@dataclass(frozen=True, slots=True)
class _Area:
    """The axes, and where names begin."""

    x: Axis
    y: Axis
    names: float

    def clipped(self, value: float | None, otherwise: float) -> float:
        """Return a value clipped to the y axis."""
        return otherwise if value is None else min(max(value, self.y.low), self.y.high)


def curves_plot(
    path: tuple[str, ...],
    title: str,
    reading: str,
    curves: Sequence[Curve],
    numbers: Sequence[int],
    label: str,
    *,
    level: float | None = None,
    notes: tuple[str, ...] = (),
) -> Plot:
    """Return a plot of curves, each in its colour.

    The axis holds all values, and the intervals that do not reach far beyond them. Intervals that do are clipped, and
    a note says so.

    Args:
        path: of the plot.
        title: of the plot.
        reading: of the plot.
        curves: one to `MAX_CURVES` of them, a knot per step.
        numbers: how many runs each step has, rising.
        label: of the y axis.
        level: a value to mark by a line.
        notes: what is not drawn.
    """
    area = _area(curves, numbers, label, level)
    colored = list(zip(curves, LINES, strict=False))
    heights = _name_heights([curve.last.value for curve in curves], area.y)
    known_knots = [knot for curve in curves for knot in curve.knots if knot]
    clipped = any(area.clipped(end, 0.0) != (end or 0.0) for knot in known_knots for end in (knot.low, knot.high))
    return Plot(
        path=path,
        title=title,
        reading=reading,
        x=area.x,
        y=area.y,
        area=(WIDE, _HEIGHT),
        bands=tuple(band for curve, color in colored for band in _bands(curve, color, area)),
        strokes=(
            *_levels(area, level),
            *(stroke for curve, color in colored for stroke in _strokes(curve, color, area)),
            *(_leader(curve, color, y, area) for (curve, color), y in zip(colored, heights, strict=True)),
        ),
        dots=tuple(
            Dot((knot.runs, knot.value), 3.0, color, knot.label)
            for curve, color in colored
            for knot in curve.knots
            if knot
        ),
        texts=tuple(
            Text((area.names, y), f" {curve.name}", anchor="left") for curve, y in zip(curves, heights, strict=True)
        ),
        notes=(*notes, "Intervals that reach beyond the axis are cut off.") if clipped else notes,
    )


def _area(curves: Sequence[Curve], numbers: Sequence[int], label: str, level: float | None) -> _Area:
    low, high = _value_range(curves, level)
    pad = max(math.exp(0.04 * (math.log(high) - math.log(low))), 1 + 1e-6) if high > low else 1.1
    # the least numbers that a float64 holds cannot be padded
    low = low / pad or low
    high = max(min(high * pad, sys.float_info.max), math.nextafter(low, math.inf))
    first, last = numbers[0], numbers[-1]
    reach = math.log(last / first) or 1.0
    left = math.exp(math.log(first) - 0.03 * reach)
    right = math.exp(math.log(last) + 1.03 * reach * _NAMES / (1 - _NAMES))
    names = math.exp(math.log(last) + 0.05 * reach)
    x = Axis(left, right, "runs so far", _run_ticks(numbers, left, right), log=True)
    return _Area(x, Axis(low, high, label, log_ticks(low, high), log=True), names)


def _value_range(curves: Sequence[Curve], level: float | None) -> tuple[float, float]:
    knots = [knot for curve in curves for knot in curve.knots if knot]
    values = [knot.value for knot in knots] + ([] if level is None else [level])
    low, high = least, most = min(values), max(values)
    for group, furthest in ((knots, _FURTHER), ([curve.last for curve in curves], _FURTHEST)):
        low = max(min([low, *(knot.low for knot in group if knot.low is not None)]), min(low, least / furthest))
        high = min(max([high, *(knot.high for knot in group if knot.high is not None)]), max(high, most * furthest))
    return low, high


def _run_ticks(numbers: Sequence[int], low: float, high: float) -> tuple[tuple[float, str], ...]:
    """Return a tick per step, chosen from the right; steps without room have no tick."""
    ticks: list[tuple[float, str]] = []
    for number in reversed(numbers):
        if not ticks or WIDE * math.log(ticks[-1][0] / number) / math.log(high / low) >= _TICK_PX:
            ticks.append((float(number), f"{number:,}"))
    return tuple(reversed(ticks))


def log_ticks(low: float, high: float) -> tuple[tuple[float, str], ...]:
    """Return round numbers for a logarithmic axis: powers of ten, and finer ones between them if these are few.

    Args:
        low: above 0.
        high: above `low`.
    """
    powers = range(math.floor(math.log10(low)), math.floor(math.log10(high)) + 1)
    for bases in ((1,), (1, 2, 5), (1, 1.5, 2, 3, 5, 7)):
        candidates = [base * 10.0**power for power in powers for base in bases]
        inside = [value for value in candidates if low <= value <= high]
        if len(inside) >= _FEWEST_TICKS:
            return tuple((value, f"{value:g}") for value in inside[:: math.ceil(len(inside) / _MOST_TICKS)])
    least = (high - low) / 8
    if least < _LEAST_SPAN:
        return (low, f"{low:g}"), (high, f"{high:g}")
    power = 10.0 ** math.floor(math.log10(least))
    step = next((base * power for base in (1, 2, 5) if base * power >= least), 10 * power)
    steps = range(math.ceil(low / step), math.floor(high / step) + 1)
    return tuple((index * step, f"{index * step:g}") for index in steps)


def _levels(area: _Area, level: float | None) -> Iterator[Stroke]:
    """Yield a line per tick, and one at the marked level. They end before the names."""
    for value, _ in area.y.ticks:
        yield Stroke(((area.x.low, value), (area.names, value)), "grid", 1.0)
    if level is not None:
        yield Stroke(((area.x.low, level), (area.names, level)), "muted", 1.5, dashed=True)


def _bands(curve: Curve, color: Color, area: _Area) -> Iterator[Band]:
    for part in _parts(
        [knot if knot and knot.low is not None and knot.high is not None else None for knot in curve.knots]
    ):
        if len(part) > 1:
            x = tuple(float(knot.runs) for knot in part)
            low = tuple(area.clipped(knot.low, knot.value) for knot in part)
            high = tuple(area.clipped(knot.high, knot.value) for knot in part)
            yield Band(x, low, high, color)


def _strokes(curve: Curve, color: Color, area: _Area) -> Iterator[Stroke]:
    for part in _parts(curve.knots):
        if len(part) > 1:
            yield Stroke(tuple((float(knot.runs), knot.value) for knot in part), color, 2.0, curve.name)
        elif part[0].low is not None and part[0].high is not None:
            x, ends = float(part[0].runs), (part[0].low, part[0].high)
            yield Stroke(tuple((x, area.clipped(end, 0.0)) for end in ends), color, 1.5, part[0].label)


def _parts(knots: Sequence[Knot | None]) -> list[list[Knot]]:
    """Return the knots in groups that no missing knot interrupts."""
    return [[knot for knot in part if knot] for is_known, part in groupby(knots, key=bool) if is_known]


def _leader(curve: Curve, color: Color, height: float, area: _Area) -> Stroke:
    return Stroke(((float(curve.last.runs), curve.last.value), (area.names, height)), color, 1.0)


def _name_heights(values: Sequence[float], y: Axis) -> list[float]:
    """Return the heights of the names: as near to the values as possible, without covering each other.

    Names that would overlap form a block around their mean (pool adjacent violators, which is least squares).
    """
    reach = math.log(y.high) - math.log(y.low)
    shares = (np.log(np.array(values)) - math.log(y.low)) / reach
    gap = _LINE_PX / _HEIGHT
    order = np.argsort(shares, kind="stable")
    targets = shares[order] - gap * np.arange(len(values))
    blocks: list[FloatArray] = []
    for value in targets:
        blocks.append(np.array([value]))
        while len(blocks) > 1 and blocks[-2].mean() > blocks[-1].mean():
            blocks[-2:] = [np.concatenate(blocks[-2:])]
    level = np.concatenate([np.full(len(block), block.mean()) for block in blocks])
    # the lowest and the highest stay within the area
    level = np.clip(level, gap / 2, 1 - gap * (len(values) - 0.5))
    placed = np.empty(len(values))
    placed[order] = level + gap * np.arange(len(values))
    return [max(math.exp(math.log(y.low) + share * reach), y.low) for share in placed.tolist()]
