"""Where a value lies on an axis, and which values are marked on it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from hrclog.analyzers.figures.arrays import FloatArray
from hrclog.analyzers.figures.plot import Axis

_FARTHEST: Final = 1e5  # px; beyond it, back ends lose count
_PLAIN: Final = (1e-5, 1e12)  # between these a number is written without an exponent

Tick = tuple[float, str]


@dataclass(frozen=True, slots=True)
class Scale:
    """An axis laid over px: its `low` lies at px `start`, its `high` at px `end`."""

    axis: Axis
    start: float
    end: float

    def at(self, values: npt.ArrayLike) -> FloatArray:
        """Return the px of values, shape as given; nan for what is not on the axis, such as 0 on a logarithmic one."""
        low, high = _span(self.axis)
        with np.errstate(all="ignore"):
            shown = np.asarray(values, dtype=np.float64)
            if self.axis.log:
                shown = np.log10(np.where(shown > 0, shown, np.nan))
            share = (shown - low) / (high - low)
            return np.clip(self.start + share * (self.end - self.start), -_FARTHEST, _FARTHEST)

    def end_at(self, values: npt.ArrayLike) -> FloatArray:
        """Return the px of the ends of bars: those that lie below any logarithm, at the low end of the axis."""
        low = min(self.axis.low, self.axis.high)
        with np.errstate(all="ignore"):
            shown = np.asarray(values, dtype=np.float64)
            return self.at(np.where(shown <= 0, low, shown) if self.axis.log else shown)

    def ticks(self, apart: float) -> tuple[Tick, ...]:
        """Return the named positions of the axis, else round numbers about `apart` px from each other."""
        if self.axis.ticks:
            return self.axis.ticks
        low, high = sorted((self.axis.low, self.axis.high))
        about = max(1.0, abs(self.end - self.start) / apart)
        if self.axis.log:
            return _log_ticks(low, high, about)
        return _linear_ticks(low, high, about)


def plain(value: float, digits: int) -> str:
    """Return a number as it is said: without an exponent where its size is ordinary, and no minus before zero."""
    if value and not _PLAIN[0] <= abs(value) < _PLAIN[1]:
        return f"{value:.6g}"
    shown = f"{value:,.{digits}f}"
    return shown.removeprefix("-") if float(shown.replace(",", "")) == 0 else shown


def _span(axis: Axis) -> tuple[float, float]:
    low, high = (math.log10(axis.low), math.log10(axis.high)) if axis.log else (axis.low, axis.high)
    return (low - 0.5, high + 0.5) if low == high else (low, high)


def _round_step(about: float) -> float:
    """Return the one of 1, 2, 5 times a power of ten that is nearest by its ratio."""
    power = 10.0 ** math.floor(math.log10(about))
    return min((factor * power for factor in (1, 2, 5, 10)), key=lambda step: abs(math.log(step / about)))


def _linear_ticks(low: float, high: float, about: float) -> tuple[Tick, ...]:
    if low == high:
        return ((low, f"{low:.6g}"),)
    step = _round_step((high - low) / about)
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return tuple((index * step, plain(index * step, digits)) for index in range(first, last + 1))


def _log_ticks(low: float, high: float, about: float) -> tuple[Tick, ...]:
    """Return 1, 2, 5 times powers of ten, fewer over many decades; round numbers where hardly one of them is there."""
    choices = [list(_powers(low, high, factors)) for factors in ((1, 2, 5), (1,))]
    ticks = next((choice for choice in choices if len(choice) <= 1.5 * about), choices[-1])
    if len(choices[0]) < 3:
        return _linear_ticks(low, high, min(about, 5.0))
    every = max(1, math.ceil(len(ticks) / (1.5 * about)))
    return tuple(ticks[::every])


def _powers(low: float, high: float, factors: tuple[int, ...]) -> Iterator[Tick]:
    first = math.floor(math.log10(low))
    for power in range(first, math.ceil(math.log10(high)) + 1):
        for factor in factors:
            value = factor * 10.0**power
            if low * (1 - 1e-9) <= value <= high * (1 + 1e-9):
                yield value, plain(value, max(0, -power))
