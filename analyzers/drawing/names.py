"""The names at the ticks of the axes: side by side, in several lines, slanted or upright, depending on the room."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from hrclog.analyzers.drawing.fonts import LINE, balanced, fitted_all, one_line, text_width
from hrclog.analyzers.drawing.scale import Scale
from hrclog.analyzers.drawing.shapes import Frame
from hrclog.analyzers.drawing.sheet import Label, Sheet, Trace
from hrclog.analyzers.figures.palette import Paint
from hrclog.analyzers.figures.plot import Anchor, Axis, Plot
from hrclog.arrays import FloatArray

NAME: Final = 13.0
NUMBER: Final = 12.0
_SMALLEST: Final = 9.0
_MARK: Final = 4.0
_GAP: Final = 8.0
_LONGEST: Final = 280.0  # px
_WIDE: Final = 240.0  # px of a name at the side, before it takes a second line
_TIGHT: Final = 1.15  # sizes from line to line of a name
_MOST_LINES: Final = 3
_SLANT: Final = 45.0

Name = tuple[float, str]


def y_names(sheet: Sheet, frame: Frame) -> int:
    """Write the ticks of y to the left of the area; return how many names are left out."""
    ticks = _place_ticks(frame.y, 64)
    _rules(sheet, frame.plot, ticks, upright=True)
    names = [(at, name) for at, name in ticks if name]
    if _is_numeric(frame.plot.y):
        spaced = _keep_apart(names, NUMBER * LINE)
        sheet.write(*(Label((-_GAP, at), number, NUMBER, "muted", "right") for at, number in spaced))
        return 0
    spaced = _keep_apart(names, _SMALLEST * _TIGHT)
    room = _spacing(spaced)
    size = _size(room)
    longest = min(_LONGEST, frame.plot.left - _GAP) if frame.plot.left > _GAP else _LONGEST
    short_names = fitted_all([name for _, name in spaced], size, longest)
    for (at, name), short in zip(spaced, short_names, strict=True):
        lines = _side_lines(name, short, size, (min(_WIDE, longest), room))
        for row, line in enumerate(lines):
            y = at + (row - (len(lines) - 1) / 2) * size * _TIGHT
            sheet.write(Label((-_GAP, y), line, size, anchor="right", full=_hidden_text(name, lines)))
    return len(names) - len(spaced)


def x_names(sheet: Sheet, frame: Frame) -> int:
    """Write the ticks of x beneath the area, or above it; return how many names are left out."""
    plot, ticks = frame.plot, _place_ticks(frame.x, 80)
    _rules(sheet, plot, ticks, upright=False)
    names = [(at, name) for at, name in ticks if name]
    if _is_numeric(plot.x):
        _write_rows(sheet, plot, [(at, (number,)) for at, number in _fit_side_by_side(names, NUMBER)], NUMBER)
        return 0
    if len(_fit_side_by_side(names, NAME)) == len(names):
        _write_rows(sheet, plot, [(at, (one_line(name),)) for at, name in names], NAME)
        return 0
    room = _spacing(names)
    name_lines = [_break_name(name, room - _GAP) for _, name in names]
    if all(name_lines):
        _write_rows(sheet, plot, [(at, lines) for (at, _), lines in zip(names, name_lines, strict=True)], NAME)
        return 0
    if room >= 2 * NAME:
        _write_turned(sheet, plot, names, NAME, _SLANT)
        return 0
    spaced = _keep_apart(names, _SMALLEST * _TIGHT)
    _write_turned(sheet, plot, spaced, _size(_spacing(spaced)), 90)
    return len(names) - len(spaced)


def _place_ticks(scale: Scale, apart: float) -> list[Name]:
    """Return the ticks within the area with their px, in order."""
    low, high = sorted((scale.start, scale.end))
    spots = [(float(scale.at(value)), name) for value, name in scale.ticks(apart)]
    return sorted((spot for spot in spots if low - 0.5 <= spot[0] <= high + 0.5), key=lambda spot: spot[0])


def _is_numeric(axis: Axis) -> bool:
    """Tell whether an axis has a scale of numbers, rather than rows or columns with names."""
    return all(name.replace(",", "").replace(".", "").lstrip("-").isdigit() for _, name in axis.ticks if name)


def _rules(sheet: Sheet, plot: Plot, names: Sequence[Name], *, upright: bool) -> None:
    """Draw the lines of the grid and, for an axis of numbers, the axis with its marks."""
    width, height = plot.area
    axis = plot.y if upright else plot.x
    # a thin line moves to the nearest px, from a half to the next: these move to the first px outside the area
    foot = -0.6 if upright or plot.names_on_top else height + 0.4
    out = foot + math.copysign(_MARK, foot)

    def line(across: tuple[float, float], along: tuple[float, float]) -> FloatArray:
        ends = np.stack([across, along], axis=1)
        return ends if upright else ends[:, ::-1]

    if axis.grid:
        other = width if upright else height
        sheet.grid += [Trace(line((0, other), (at, at)), "grid") for at, _ in names]
    if _is_numeric(axis):
        sheet.lines.append(Trace(line((foot, foot), (0, height if upright else width)), "muted"))
        sheet.lines += [Trace(line((foot, out), (at, at)), "muted") for at, _ in names]


def _spacing(names: Sequence[Name]) -> float:
    return min((right - left for (left, _), (right, _) in pairwise(names)), default=math.inf)


def _size(room: float) -> float:
    return max(_SMALLEST, math.floor(min(NAME, room / _TIGHT)))


def _keep_apart(names: Sequence[Name], least: float) -> list[Name]:
    """Return as many names as fit with at least a distance between them."""
    spaced: list[Name] = []
    for at, name in names:
        if not spaced or at - spaced[-1][0] >= least - 1e-6:
            spaced.append((at, name))
    return spaced


def _fit_side_by_side(names: Sequence[Name], size: float) -> list[Name]:
    """Return as many names as fit beside each other on one line."""
    fitting: list[Name] = []
    end = -math.inf
    for at, name in names:
        half = text_width(one_line(name), size) / 2
        if at - half >= end and half <= _LONGEST / 2:
            fitting.append((at, name))
            end = at + half + _GAP
    return fitting


def _side_lines(name: str, short: str, size: float, room: tuple[float, float]) -> tuple[str, ...]:
    """Return the lines of a name at the side: one, if it is short or if several do not fit into the room."""
    width, height = room
    if text_width(short, size) <= width and short == one_line(name):
        return (short,)
    lines = balanced(name, size, width)
    return lines if 0 < len(lines) <= _MOST_LINES and len(lines) * size * _TIGHT <= height else (short,)


def _break_name(name: str, room: float) -> tuple[str, ...]:
    """Return a name in a few lines, none if it does not break into them well."""
    lines = balanced(name, NAME, room) if room > 0 else ()
    return lines if len(lines) <= _MOST_LINES else ()


def _hidden_text(name: str, lines: Sequence[str]) -> str:
    """Return the full name if the lines shorten it, else ""."""
    return "" if "".join(lines).replace(" ", "") == one_line(name).replace(" ", "") else name


def _write_rows(sheet: Sheet, plot: Plot, names: Sequence[tuple[float, tuple[str, ...]]], size: float) -> None:
    paint: Paint = "muted" if _is_numeric(plot.x) else "ink"
    for at, lines in names:
        height = len(lines) * size * LINE
        top = -_MARK - 3 - height if plot.names_on_top else plot.area[1] + _MARK + 3
        sheet.paragraph(lines, top, Label((at, 0), "", size, paint))


def _write_turned(sheet: Sheet, plot: Plot, names: Sequence[Name], size: float, angle: float) -> None:
    y = -_GAP if plot.names_on_top else plot.area[1] + _GAP
    anchor: Anchor = "left" if plot.names_on_top else "right"
    short_names = fitted_all([name for _, name in names], size, _LONGEST)
    for (at, name), short in zip(names, short_names, strict=True):
        sheet.write(Label((at, y), short, size, anchor=anchor, angle=angle, full=_hidden_text(name, (short,))))
