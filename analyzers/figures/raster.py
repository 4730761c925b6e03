"""A heatmap as pixels: no view of the viewer has named rows and columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from PIL import Image, ImageDraw

from hrclog.analyzers.figures.arrays import Pixels
from hrclog.analyzers.figures.font import readable
from hrclog.analyzers.figures.heatmap import Heatmap
from hrclog.analyzers.figures.palette import CARD, INK, MUTED, Color, blend, ink_on
from hrclog.analyzers.figures.text import shorten

TITLE: Final = 21
LABEL: Final = 16
SMALL: Final = 14
VALUE: Final = 22
_PAD: Final = 22
_GAP: Final = 3
_BAR: Final = 12
_ROOMY: Final = 84
_UNSAID: Final = "What does not fit into a cell is in the tables."


class Sheet:
    """A card to draw on, in px from its upper left corner."""

    def __init__(self, width: int, height: int, fill: Color = CARD) -> None:
        self._image = Image.new("RGB", (width, height), fill)
        self._draw = ImageDraw.Draw(self._image)

    def text(self, at: tuple[float, float], text: str, size: int, fill: Color = INK, anchor: str = "la") -> None:
        """Write a line; `anchor` is Pillow's, e.g. "mm" for the middle."""
        shown, font = readable(text, size)
        self._draw.text(at, shown, font=font, fill=fill, anchor=anchor)

    def upward(self, at: tuple[int, int], text: str, size: int, fill: Color = INK) -> None:
        """Write a line that runs up from its lower middle `at`."""
        shown, font = readable(text, size)
        width, height = text_width(text, size) + 2, size + 6
        strip = Image.new("RGB", (width, height), CARD)
        ImageDraw.Draw(strip).text((0, height / 2), shown, font=font, fill=fill, anchor="lm")
        self._image.paste(strip.transpose(Image.Transpose.ROTATE_90), (at[0] - height // 2, at[1] - width))

    def box(self, left: float, top: float, right: float, bottom: float, fill: Color) -> None:
        """Fill a rectangle, its right and bottom edge excluded."""
        self._draw.rectangle((left, top, right - 1, bottom - 1), fill=fill)

    def line(self, points: Sequence[tuple[float, float]], fill: Color, width: int = 1) -> None:
        """Draw a line through points."""
        self._draw.line(points, fill=fill, width=width)

    def pixels(self) -> Pixels:
        """Return the card, shape (height, width, 3)."""
        return np.asarray(self._image)


def text_width(text: str, size: int) -> int:
    """Return the width of a line in px."""
    shown, font = readable(text, size)
    return int(np.ceil(font.getlength(shown)))


def wrapped(text: str, size: int, width: int) -> list[str]:
    """Return the text in lines of at most `width` px, broken after "_", "-", "/", "." or a space, or where it must."""
    lines, line = [], ""
    for piece in _pieces(text):
        if line and text_width(line + piece, size) > width:
            lines.append(line)
            line = ""
        line += piece
        while text_width(line, size) > width and len(line) > 1:
            keep = max(1, len(line) * width // text_width(line, size))
            lines.append(line[:keep])
            line = line[keep:]
    return [*lines, line]


def sentences(text: str, width: int) -> list[str]:
    """Return a caption in lines of at most `width` px."""
    lines = [""]
    for word in text.split():
        if lines[-1] and text_width(f"{lines[-1]} {word}", SMALL) > width:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return lines


@dataclass(frozen=True, slots=True)
class _Layout:
    rows: tuple[str, ...]
    columns: tuple[tuple[str, ...], ...]
    cell: tuple[int, int]
    corner: tuple[int, int]
    rotated: bool
    footer: tuple[str, ...]
    size: tuple[int, int]


def draw_heatmap(heatmap: Heatmap) -> Pixels:
    """Return the picture: names, coloured cells with their numbers, a scale and the captions."""
    layout = _layout(heatmap)
    sheet = Sheet(*layout.size)
    sheet.text((_PAD, _PAD), heatmap.title, TITLE)
    left, top = layout.corner
    sheet.text((left, _PAD + TITLE + 14), f"{heatmap.column_title} ...", SMALL, MUTED)
    sheet.text((_PAD, top - 8), heatmap.row_title, SMALL, MUTED, "ls")
    _names(sheet, layout)
    for row in range(len(layout.rows)):
        for column in range(len(layout.columns)):
            _cell(sheet, heatmap, layout, row, column)
    _footer(sheet, heatmap, layout)
    return sheet.pixels()


def _layout(heatmap: Heatmap) -> _Layout:
    rows = tuple(shorten(name, 26) for name in heatmap.rows)
    names = tuple(shorten(name, 26) for name in heatmap.columns)
    side = max(len(rows), len(names), 1)
    width = max(22, min(132, 900 // side))
    height = max(22, min(84, 640 // side))
    rotated = width < _ROOMY
    columns = tuple((name,) if rotated else tuple(wrapped(name, LABEL, width - 6)) for name in names)
    widest = max([text_width(name, LABEL) for name in rows] + [text_width(heatmap.row_title, SMALL)])
    head = max((text_width(name, LABEL) for name in names), default=0) if rotated else 0
    head = head or max(map(len, columns), default=1) * (LABEL + 4)
    left, top = _PAD + widest + 12, _PAD + TITLE + 14 + SMALL + 12 + head + 10
    total = max(left + len(names) * width, _PAD + text_width(heatmap.title, TITLE), left + 330) + _PAD
    captions = (*heatmap.captions, _UNSAID) if width < _ROOMY else heatmap.captions
    footer = tuple(line for text in captions for line in sentences(text, total - 2 * _PAD))
    bottom = top + len(rows) * height + 16 + _BAR + 8 + SMALL + 14 + len(footer) * (SMALL + 6) + _PAD
    return _Layout(rows, columns, (width, height), (left, top), rotated, footer, (total, bottom))


def _names(sheet: Sheet, layout: _Layout) -> None:
    (left, top), (width, height) = layout.corner, layout.cell
    for index, name in enumerate(layout.rows):
        sheet.text((left - 12, top + (index + 0.5) * height), name, LABEL, INK, "rm")
    for index, lines in enumerate(layout.columns):
        middle = left + int((index + 0.5) * width)
        if layout.rotated:
            sheet.upward((middle, top - 8), lines[0], LABEL)
            continue
        for up, line in enumerate(reversed(lines)):
            sheet.text((middle, top - 10 - up * (LABEL + 4)), line, LABEL, INK, "ms")


def _cell(sheet: Sheet, heatmap: Heatmap, layout: _Layout, row: int, column: int) -> None:
    (left, top), (width, height) = layout.corner, layout.cell
    x, y = left + column * width, top + row * height
    value = heatmap.values[row, column]
    fill = heatmap.color(value)
    sheet.box(x, y, x + width - _GAP, y + height - _GAP, fill)
    middle, ink = x + (width - _GAP) / 2, ink_on(fill)
    notes = _notes(heatmap, row, column) if width >= _ROOMY and height >= 60 else ()
    said = f"{value:,.{heatmap.digits}f}" if np.isfinite(value) else "n/a"
    if heatmap.doubtful is not None and heatmap.doubtful[row, column]:
        said += "*"
    size = next((size for size in (VALUE, LABEL, SMALL, 11) if text_width(said, size) <= width - 8), None)
    if size is None:
        return
    first = y + (height - _GAP) / 2 - len(notes) * (SMALL + 3) / 2
    sheet.text((middle, first), said, size, ink, "mm")
    for index, note in enumerate(notes):
        sheet.text((middle, first + 21 + index * (SMALL + 3)), note, SMALL, blend(ink, fill, 0.1), "mm")


def _notes(heatmap: Heatmap, row: int, column: int) -> tuple[str, ...]:
    if not np.isfinite(heatmap.values[row, column]):
        return ()
    notes = []
    if heatmap.low is not None and heatmap.high is not None and np.isfinite(heatmap.low[row, column]):
        low, high = (f"{ends[row, column]:,.{heatmap.digits}f}" for ends in (heatmap.low, heatmap.high))
        notes.append(f"{low} to {high}")
    if heatmap.counts is not None and np.isfinite(heatmap.counts[row, column]):
        notes.append(f"n = {int(heatmap.counts[row, column]):,}")
    return tuple(notes)


def _footer(sheet: Sheet, heatmap: Heatmap, layout: _Layout) -> None:
    left, top = layout.corner
    y, width = top + len(layout.rows) * layout.cell[1] + 16, 320
    limit = heatmap.limit
    log = heatmap.scale == "diverging"
    for x in range(width):
        share = x / (width - 1)
        sheet.box(
            left + x, y, left + x + 1, y + _BAR, heatmap.color(limit ** (2 * share - 1) if log else limit * share)
        )
    known = heatmap.values[np.isfinite(heatmap.values)]
    less, more = (" or less" if (known < 1 / limit).any() else ""), (" or more" if (known > limit).any() else "")
    ends = (
        (f"{1 / limit:.2f}{less}", "1 = no effect", f"{limit:.2f}{more}")
        if log
        else ("0", "", f"{limit:,.{heatmap.digits}f}")
    )
    below = y + _BAR + 8
    for said, share, anchor in zip(ends, (0.0, 0.5, 1.0), ("la", "ma", "ra"), strict=True):
        sheet.text((left + share * width, below), said, SMALL, MUTED, anchor)
    for index, line in enumerate(layout.footer):
        sheet.text((_PAD, below + SMALL + 14 + index * (SMALL + 6)), line, SMALL, MUTED)


def _pieces(text: str) -> list[str]:
    pieces = [""]
    for char in text:
        pieces[-1] += char
        if char in "_-/. ":
            pieces.append("")
    return [piece for piece in pieces if piece] or [""]
