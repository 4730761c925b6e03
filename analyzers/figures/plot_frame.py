"""A sheet for a plot of named rows over a horizontal axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from hrclog.analyzers.figures.axis import Axis, axis
from hrclog.analyzers.figures.palette import GRID, INK, MUTED
from hrclog.analyzers.figures.raster import LABEL, SMALL, TITLE, Sheet, sentences, text_width

WIDE: Final = 1000
"""Px of an axis that has a page for itself."""
NARROW: Final = 430
"""Px of an axis beside another plot."""

_PAD: Final = 22
_ROW: Final = 34
_DENSE_ROW: Final = 24
_MANY: Final = 24


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """A name on the left; a heading stands out and has no data."""

    name: str
    heading: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """A sheet with title, names, grid and captions, and where its rows lie; all in px."""

    sheet: Sheet
    scale: Axis
    top: int
    pitch: int
    rows: int

    @property
    def bottom(self) -> int:
        """Return the lower end of the last row."""
        return self.top + max(self.rows, 1) * self.pitch

    def middle(self, row: int) -> float:
        """Return the height of the middle of a row."""
        return self.top + (row + 0.5) * self.pitch


def plot_frame(
    title: str, unit: str, rows: Sequence[Row], ends: tuple[float, float], captions: Sequence[str], width: int
) -> Frame:
    """Return the frame of a plot whose axis holds both `ends` and is `width` px wide."""
    widest = max([text_width(row.name, LABEL) for row in rows], default=0)
    left, top = _PAD + widest + 20, _PAD + TITLE + 18
    total = max(left + width, _PAD + text_width(title, TITLE)) + 2 * _PAD
    lines = [line for text in captions for line in sentences(text, total - 2 * _PAD)]
    pitch = _ROW if len(rows) <= _MANY else _DENSE_ROW
    below = top + max(len(rows), 1) * pitch + 2 * (SMALL + 8) + 16
    sheet = Sheet(total, below + len(lines) * (SMALL + 6) + _PAD)
    frame = Frame(sheet, axis(*ends, left, left + width), top, pitch, len(rows))
    sheet.text((_PAD, _PAD), title, TITLE)
    _draw_axis(frame, unit)
    _draw_names(frame, rows)
    for index, line in enumerate(lines):
        sheet.text((_PAD, below + index * (SMALL + 6)), line, SMALL, MUTED)
    return frame


def _draw_axis(frame: Frame, unit: str) -> None:
    for tick in frame.scale.ticks():
        x = frame.scale.at(tick)
        frame.sheet.line([(x, frame.top), (x, frame.bottom)], GRID)
        frame.sheet.text((x, frame.bottom + 8), f"{tick:g}", SMALL, MUTED, "ma")
    frame.sheet.text((frame.scale.right, frame.bottom + SMALL + 16), unit, SMALL, MUTED, "ra")


def _draw_names(frame: Frame, rows: Sequence[Row]) -> None:
    for index, row in enumerate(rows):
        if row.heading:
            frame.sheet.text((_PAD, frame.middle(index)), row.name, LABEL, MUTED, "lm")
        else:
            frame.sheet.text((frame.scale.left - 14, frame.middle(index)), row.name, LABEL, INK, "rm")
    if not rows:
        middle = (frame.scale.left + frame.scale.right) / 2
        frame.sheet.text((middle, frame.middle(0)), "nothing observed", LABEL, MUTED, "mm")
