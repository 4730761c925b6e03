"""Where a value lies on an axis, and which values are marked on it."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from hrclog.analyzers.figures.plot import Axis
from hrclog.arrays import FloatArray

_FARTHEST: Final = 1e5  # px; beyond it, back ends lose count
_MANY_SPANS: Final = 1e9  # of an axis; beyond it, px lie beyond the farthest too
_PLAIN: Final = (1e-5, 1e12)  # between these a number is written without an exponent
_MOST_DIGITS: Final = 5  # of a zero; steps that need more are mostly written with an exponent
_LEAST_SPAN: Final = 1e-300  # of steps of which all are powers of ten that a float64 holds
_NEAREST: Final = 1e-12  # of the values: steps within a smaller span are hardly told apart by a float64
_POWERS: Final = (-323, 308)  # of ten, that a float64 holds

Tick = tuple[float, str]


@dataclass(frozen=True, slots=True)
class Scale:
    """An axis laid over px: its `low` lies at px `start`, its `high` at px `end`."""

    axis: Axis
    start: float
    end: float

    def at(self, values: npt.ArrayLike) -> FloatArray:
        """Return the px of values, same shape; nan for values not on the axis, such as 0 on a logarithmic one."""
        low, high = _span(self.axis)
        with np.errstate(all="ignore"):
            numbers = np.asarray(values, dtype=np.float64)
            if self.axis.log:
                numbers = np.log10(np.where(numbers > 0, numbers, np.nan))
            if not math.isfinite(high - low):
                low, high, numbers = low / 4, high / 4, numbers / 4
            share = np.clip((numbers - low) / (high - low), -_MANY_SPANS, _MANY_SPANS)
            return np.clip(self.start + share * (self.end - self.start), -_FARTHEST, _FARTHEST)

    def end_at(self, values: npt.ArrayLike) -> FloatArray:
        """Return the px of the ends of bars. On a logarithmic axis, ends at or below 0 lie at its low end."""
        low = min(self.axis.low, self.axis.high)
        with np.errstate(all="ignore"):
            numbers = np.asarray(values, dtype=np.float64)
            return self.at(np.where(numbers <= 0, low, numbers) if self.axis.log else numbers)

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
    """Return a number as text: without an exponent if its size is ordinary, and without a minus before zero."""
    if value and not _PLAIN[0] <= abs(value) < _PLAIN[1]:
        return f"{value:.6g}"
    if not value and digits > _MOST_DIGITS:
        return "0"
    text = f"{value:,.{digits}f}"
    return text.removeprefix("-") if float(text.replace(",", "")) == 0 else text


def _span(axis: Axis) -> tuple[float, float]:
    low, high = (math.log10(axis.low), math.log10(axis.high)) if axis.log else (axis.low, axis.high)
    if low < high or high < low:
        return low, high
    pad = max(0.5, abs(low) * 1e-9)
    return max(low - pad, -sys.float_info.max), min(high + pad, sys.float_info.max)


def _round_step(about: float) -> float:
    """Return the number of the form 1, 2 or 5 times a power of ten that has the nearest ratio."""
    power = 10.0 ** math.floor(math.log10(about))
    return min((factor * power for factor in (1, 2, 5, 10)), key=lambda step: abs(math.log(step / about)))


def _linear_ticks(low: float, high: float, about: float) -> tuple[Tick, ...]:
    if low == high:
        return ((low, f"{low:.6g}"),)
    if high - low < max(_LEAST_SPAN, _NEAREST * max(abs(low), abs(high))):
        return (low, f"{low:.6g}"), (high, f"{high:.6g}")
    parts = max(about, 2.0) if math.isinf(high - low) else about
    step = _round_step(high / parts - low / parts)
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return tuple((index * step, plain(index * step, digits)) for index in range(first, last + 1))


def _log_ticks(low: float, high: float, about: float) -> tuple[Tick, ...]:
    """Return 1, 2, 5 times powers of ten, fewer over many decades, or round numbers if there are hardly any of them."""
    choices = [list(_powers(low, high, factors)) for factors in ((1, 2, 5), (1,))]
    ticks = next((choice for choice in choices if len(choice) <= 1.5 * about), choices[-1])
    if len(choices[0]) < 3:
        return _linear_ticks(low, high, min(about, 5.0))
    every = max(1, math.ceil(len(ticks) / (1.5 * about)))
    return tuple(ticks[::every])


def _powers(low: float, high: float, factors: tuple[int, ...]) -> Iterator[Tick]:
    first, last = max(math.floor(math.log10(low)), _POWERS[0]), min(math.ceil(math.log10(high)), _POWERS[1])
    for power in range(first, last + 1):
        for factor in factors:
            value = factor * 10.0**power
            if math.isfinite(value) and low * (1 - 1e-9) <= value <= high * (1 + 1e-9):
                yield value, plain(value, max(0, -power))
