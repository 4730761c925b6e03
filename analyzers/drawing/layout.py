"""Where everything lies: names, labels, legend, colour bar and captions around the area between the axes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from hrclog.analyzers.drawing import shapes
from hrclog.analyzers.drawing.fonts import LINE, fitted, text_width, wrapped
from hrclog.analyzers.drawing.names import x_names, y_names
from hrclog.analyzers.drawing.scale import Scale
from hrclog.analyzers.drawing.shapes import Frame
from hrclog.analyzers.drawing.sheet import Box, Circle, Label, Sheet
from hrclog.analyzers.figures.plot import ColorBar, Key, Plot

TITLE: Final = 17.0
LABEL: Final = 13.0
CAPTION: Final = 12.5
_PAD: Final = 12.0
_GAP: Final = 8.0
_NARROWEST: Final = 420.0  # px of a picture with captions
_KEY: Final = 14.0  # px of a legend's shape
_BAR: Final = (320.0, 12.0)


@dataclass(frozen=True, slots=True)
class Layout:
    """A plot on a picture of `width` by `height` px: the sheet around its area, and the frame of its marks."""

    width: int
    height: int
    sheet: Sheet
    frame: Frame


def lay_out(plot: Plot, *, captions: bool) -> Layout:
    """Place a plot; `captions` adds its title, reading and notes."""
    width, height = plot.area
    frame = Frame(plot, Scale(plot.x, 0, width), Scale(plot.y, height, 0))
    sheet = Sheet((0, 0, width, height))
    sheet.take(*shapes.outlines(frame))
    n_left_out = y_names(sheet, frame) + x_names(sheet, frame)
    _axis_labels(sheet, plot)
    sheet.take((-plot.left, 0, 0, 0))
    if captions:
        sheet.take((sheet.left, sheet.top, sheet.left + _NARROWEST, sheet.bottom))
    _legend(sheet, plot.keys, width)
    if plot.color_bar is not None:
        _color_bar(sheet, plot.color_bar, width)
    if captions:
        _captions(sheet, plot, (*plot.notes, *([f"{n_left_out} names at the axes do not fit."] if n_left_out else [])))
    left, top = math.floor(sheet.left - _PAD), math.floor(sheet.top - _PAD)
    right, bottom = math.ceil(sheet.bounds[2] + _PAD), math.ceil(sheet.bottom + _PAD)
    moved_frame = Frame(plot, Scale(plot.x, -left, width - left), Scale(plot.y, height - top, -top))
    return Layout(right - left, bottom - top, sheet.moved(-left, -top), moved_frame)


def _axis_labels(sheet: Sheet, plot: Plot) -> None:
    width, height = plot.area
    if plot.x.label:
        lines = wrapped(plot.x.label, LABEL, max(width, 160))
        top = sheet.top - _GAP / 2 - len(lines) * LABEL * LINE if plot.names_on_top else sheet.bottom + _GAP / 2
        sheet.paragraph(lines, top, Label((width / 2, 0), "", LABEL, "muted"))
    if plot.y.label:
        lines = wrapped(plot.y.label, LABEL, max(height, 160))
        left = sheet.left - _GAP - len(lines) * LABEL * LINE
        sheet.write(
            *(
                Label((left + (row + 0.5) * LABEL * LINE, height / 2), line, LABEL, "muted", angle=90)
                for row, line in enumerate(lines)
            )
        )


def _legend(sheet: Sheet, keys: Sequence[Key], width: float) -> None:
    """Put keys above the area in as many rows as they need."""
    if not keys:
        return
    room = max(sheet.width, 160)
    rows = list(_key_rows(keys, room))
    needed = sum(_key_width(key, room) for key in keys)
    left = 0.0 if len(rows) == 1 and needed <= width else sheet.left
    step = CAPTION * LINE + 4
    top = sheet.top - _GAP - len(rows) * step
    for row, members in enumerate(rows):
        x, y = left, top + (row + 0.5) * step
        for key in members:
            _key(sheet, key, (x, y), room)
            x += _key_width(key, room)


def _key_rows(keys: Sequence[Key], room: float) -> Iterator[list[Key]]:
    row: list[Key] = []
    used = 0.0
    for key in keys:
        width = _key_width(key, room)
        if row and used + width > room + 2 * _GAP:
            yield row
            row, used = [], 0.0
        row.append(key)
        used += width
    yield row


def _key_width(key: Key, room: float) -> float:
    return _KEY + 6 + text_width(_key_text(key, room), CAPTION) + 2 * _GAP


def _key_text(key: Key, room: float) -> str:
    return fitted(key.label, CAPTION, room - _KEY - 6)


def _key(sheet: Sheet, key: Key, at: tuple[float, float], room: float) -> None:
    x, y = at
    if key.shape == "box":
        sheet.boxes.append(Box((x, y - 6, x + _KEY, y + 6), key.paint))
    elif key.shape == "line":
        sheet.rule((x, y), (x + _KEY, y), key.paint, 2.5)
    else:
        sheet.circles.append(Circle((x + _KEY / 2, y), 5, key.paint, key.rim))
    sheet.write(Label((x + _KEY + 6, y), _key_text(key, room), CAPTION, anchor="left", full=key.label))


def _color_bar(sheet: Sheet, bar: ColorBar, width: float) -> None:
    """Put a strip of the fills under the area, its label above it and its ticks below."""
    length, thick = min(_BAR[0], max(width, sheet.width)), _BAR[1]
    left = 0.0 if length <= width else sheet.left
    top = sheet.bottom + 2 * _GAP
    if bar.label:
        lines = wrapped(bar.label, CAPTION, max(sheet.bounds[2] - left, 160))
        sheet.paragraph(lines, top, Label((left, 0), "", CAPTION, "muted", "left"))
        top = sheet.bottom + _GAP / 2
    step = length / max(1, len(bar.paints))
    for index, paint in enumerate(bar.paints):
        # each box reaches under the next one, else thin seams would show between them
        right = left + min(length, (index + 2) * step)
        sheet.boxes.append(Box((left + index * step, top, right, top + thick), paint))
    sheet.take((left, top, left + length, top + thick))
    end = -math.inf
    for share, name in bar.ticks:
        x, y = left + share * length, top + thick
        label = Label((x, y + 12), fitted(name, CAPTION, length), CAPTION, "muted")
        if name and label.bounds[0] > end:
            sheet.rule((x, y), (x, y + 4), "muted")
            sheet.write(label)
            end = label.bounds[2] + _GAP


def _captions(sheet: Sheet, plot: Plot, notes: Sequence[str]) -> None:
    room = sheet.width
    reading = wrapped(plot.reading, CAPTION, room) if plot.reading else ()
    if reading:
        top = sheet.top - _GAP - len(reading) * CAPTION * LINE
        sheet.paragraph(reading, top, Label((sheet.left, 0), "", CAPTION, "muted", "left"))
    title = wrapped(plot.title, TITLE, room, bold=True) if plot.title else ()
    top = sheet.top - _GAP / 2 - len(title) * TITLE * LINE
    sheet.paragraph(title, top, Label((sheet.left, 0), "", TITLE, "ink", "left", bold=True))
    for index, note in enumerate(notes):
        top = sheet.bottom + (_GAP if index else 1.5 * _GAP)
        sheet.paragraph(wrapped(note, CAPTION, room), top, Label((sheet.left, 0), "", CAPTION, "muted", "left"))
