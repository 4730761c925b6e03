"""A heatmap as a plot: a cell per pair of tasks, its number, and how sure that is."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from hrclog.analyzers.figures.heatmap import Heatmap
from hrclog.analyzers.figures.palette import Paint, ink_on
from hrclog.analyzers.figures.plot import Axis, ColorBar, Plot, Rect, Text
from hrclog.analyzers.figures.text import shorten_apart

_WIDEST: Final = 124
_NARROWEST: Final = 24
_HIGHEST: Final = 82
_LINE: Final = 18
_ROOMY: Final = (84, 64)
"""Px of a cell that holds its number, interval and count."""
_READABLE: Final = 36
"""Px of a cell in which a number can be read. Smaller grey cells have no text."""
_GAP_PX: Final = 2
_ACROSS: Final = 900
_BAR_STEPS: Final = 48
_UNSAID: Final = "Intervals and counts do not fit into the cells; the tables have them."


def heatmap_plot(heatmap: Heatmap, path: tuple[str, ...]) -> Plot:
    """Return a matrix with named rows and columns; cells without a value are grey and say n/a, and on hover why."""
    rows, columns = heatmap.values.shape
    width = min(max(_ACROSS // max(columns, 1), _NARROWEST), _WIDEST)
    height = min(max(width * 2 // 3, _NARROWEST), _HIGHEST)
    roomy = width >= _ROOMY[0] and height >= _ROOMY[1] - 8
    cells = [(row, column) for row in range(rows) for column in range(columns)]
    hides_notes = not roomy and bool(np.isfinite(heatmap.values).any())
    return Plot(
        path=path,
        title=heatmap.title,
        reading=heatmap.reading,
        x=Axis(0, max(columns, 1), f"{heatmap.column_title} …", _ticks(heatmap.columns)),
        y=Axis(max(rows, 1), 0, heatmap.row_title, _ticks(heatmap.rows)),
        area=(max(columns, 1) * width, max(rows, 1) * height),
        rects=tuple(_cell(heatmap, row, column, width, height) for row, column in cells),
        texts=tuple(text for row, column in cells for text in _texts(heatmap, row, column, width, height, roomy=roomy)),
        color_bar=_color_bar(heatmap),
        names_on_top=True,
        notes=(*heatmap.captions, _UNSAID) if hides_notes else heatmap.captions,
    )


def _ticks(names: tuple[str, ...]) -> tuple[tuple[float, str], ...]:
    labels = shorten_apart(names, 32 if len(names) <= 12 else 26)
    return tuple((index + 0.5, labels[name]) for index, name in enumerate(names))


def _cell(heatmap: Heatmap, row: int, column: int, width: int, height: int) -> Rect:
    x, y = _GAP_PX / 2 / width, _GAP_PX / 2 / height
    low, high = (column + x, row + y), (column + 1 - x, row + 1 - y)
    return Rect(low, high, _paint(heatmap, row, column), cell_label(heatmap, row, column))


def _paint(heatmap: Heatmap, row: int, column: int) -> Paint:
    return heatmap.paint(float(heatmap.values[row, column]))


def cell_label(heatmap: Heatmap, row: int, column: int) -> str:
    """Return what a cell says on hover: the tasks, the number, and how sure it is or why there is none."""
    parts = [cell_text(heatmap, row, column), *_notes(heatmap, row, column)]
    return f"{heatmap.rows[row]}, {heatmap.columns[column]}: {', '.join(parts)}"


def _texts(heatmap: Heatmap, row: int, column: int, width: int, height: int, *, roomy: bool) -> Iterator[Text]:
    fill = _paint(heatmap, row, column)
    if isinstance(fill, str) and width < _READABLE:
        return
    ink: Paint = "muted" if isinstance(fill, str) else ink_on(fill)
    notes = _notes(heatmap, row, column) if roomy else []
    if len(notes) == 1 and not np.isfinite(heatmap.values[row, column]):
        notes = []  # nothing was seen there: grey says enough
    lines = [(cell_text(heatmap, row, column), 19 if roomy else 12), *((note, 12) for note in notes)]
    first = row + 0.5 - (len(lines) - 1) * _LINE / 2 / height
    for index, (text, size) in enumerate(lines):
        at = (column + 0.5, first + index * _LINE / height)
        yield Text(at, text, ink, size, bold=roomy and not index and not isinstance(fill, str), room=0.94)


def cell_text(heatmap: Heatmap, row: int, column: int) -> str:
    """Return the number of a cell, n/a where it has none, with a mark where it is in doubt."""
    value = heatmap.values[row, column]
    if not np.isfinite(value):
        return "n/a"
    doubtful = heatmap.doubtful is not None and heatmap.doubtful[row, column]
    return f"{value:,.{heatmap.digits}f}{'*' if doubtful else ''}"


def _notes(heatmap: Heatmap, row: int, column: int) -> list[str]:
    """Return the interval or the reason why there is no value, and the count."""
    if not np.isfinite(heatmap.values[row, column]):
        return _reason(heatmap, row, column)
    notes = []
    if heatmap.low is not None and heatmap.high is not None and np.isfinite(heatmap.low[row, column]):
        low, high = (f"{ends[row, column]:,.{heatmap.digits}f}" for ends in (heatmap.low, heatmap.high))
        notes.append(f"{low} to {high}")
    if heatmap.counts is not None and np.isfinite(heatmap.counts[row, column]):
        notes.append(f"n = {int(heatmap.counts[row, column]):,}")
    return notes


def _reason(heatmap: Heatmap, row: int, column: int) -> list[str]:
    """Return why there is no value, and the count of what was seen."""
    if heatmap.reasons is None or not heatmap.reasons[row][column]:
        return []
    seen = heatmap.counts is not None and heatmap.counts[row, column] > 0
    count = [f"n = {int(heatmap.counts[row, column]):,}"] if heatmap.counts is not None and seen else []
    return [heatmap.reasons[row][column], *count]


def _color_bar(heatmap: Heatmap) -> ColorBar:
    limit, shares = heatmap.limit, [(step + 0.5) / _BAR_STEPS for step in range(_BAR_STEPS)]
    if heatmap.scale == "sequential":
        paints = tuple(heatmap.paint(limit * share) for share in shares)
        return ColorBar(paints, ((0.0, "0"), (1.0, f"{limit:,.{heatmap.digits}f}")), heatmap.unit)
    finite = heatmap.values[np.isfinite(heatmap.values)]
    less, more = (" or less" if (finite < 1 / limit).any() else ""), (" or more" if (finite > limit).any() else "")
    paints = tuple(heatmap.paint(limit ** (2 * share - 1)) for share in shares)
    ends = (0.0, f"{1 / limit:.2f}{less}"), (0.5, "1 = no effect"), (1.0, f"{limit:.2f}{more}")
    return ColorBar(paints, ends, heatmap.unit)
