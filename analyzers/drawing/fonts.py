"""Fonts that have the characters of a text, and the width of a text in them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Final

from matplotlib.font_manager import FontProperties, findfont, fontManager, get_font
from matplotlib.ft2font import FT2Font
from matplotlib.textpath import text_to_path
from PIL import ImageFont

from hrclog.analyzers.figures.text import beginning, ending, printable, shorten, shorten_apart

LINE: Final = 1.3
"""The height of a line, in multiples of its text size."""
RISE: Final = 0.36
"""How far the middle of a line lies above its baseline, in multiples of its text size."""

_FIRST: Final = "DejaVu Sans"  # matplotlib carries it
# families and the files that contain them; none is required
_WIDER: Final = {
    "Noto Sans CJK SC": ("NotoSansCJK-Regular.ttc", "NotoSansCJK-Bold.ttc"),
    "Noto Sans": ("NotoSans-Regular.ttf", "NotoSans-Bold.ttf"),
    "Noto Sans Arabic": ("NotoSansArabic-Regular.ttf",),
    "WenQuanYi Micro Hei": ("wqy-microhei.ttc",),
    "Arial Unicode MS": ("Arial Unicode.ttf",),
    "Microsoft YaHei": ("msyh.ttc", "msyhbd.ttc"),
    "MS Gothic": ("msgothic.ttc",),
    "Malgun Gothic": ("malgun.ttf",),
    "Arial": ("arial.ttf", "arialbd.ttf"),
}
_FORBIDDEN: Final = {0xFFFE: "·", 0xFFFF: "·"}
_BREAKS: Final = "_-/. "
_MEASURED: Final = 100.0  # pt, large enough that rounding does not show
_FEWEST: Final = 8  # characters in which names can be kept apart


def legal(text: str) -> str:
    """Return the printable text of one or more lines, without two characters that XML forbids."""
    return "\n".join(map(one_line, text.splitlines()))


def one_line(text: str) -> str:
    """Return the printable text, without two characters that XML forbids."""
    return printable(text.translate(_FORBIDDEN))


@lru_cache(maxsize=256)
def font(points: float, *, bold: bool, wide: bool) -> FontProperties:
    """Return the font of a size. A `wide` font also searches the system's fonts for each glyph."""
    return FontProperties(
        family=list(_families() if wide else (_FIRST,)), size=points, weight="bold" if bold else "normal"
    )


@lru_cache(maxsize=20_000)
def is_wide(text: str) -> bool:
    """Tell whether a text has characters that DejaVu Sans lacks."""
    return not text.isascii() and any(not _plain_font().get_char_index(ord(char)) for char in text)


@lru_cache(maxsize=1)
def _plain_font() -> FT2Font:
    return get_font(findfont(font(_MEASURED, bold=False, wide=False)))


def text_width(text: str, size: float, *, bold: bool = False) -> float:
    """Return the width of a line in px."""
    return _measure(text, bold=bold)[0] * size


def text_reach(text: str, size: float, *, bold: bool = False) -> tuple[float, float]:
    """Return the px of a line above and below its middle: half a line's height, or more for tall characters."""
    _, above, below = _measure(text, bold=bold)
    return max(LINE / 2, above - RISE) * size, max(LINE / 2, below + RISE) * size


@lru_cache(maxsize=20_000)
def _measure(text: str, *, bold: bool) -> tuple[float, float, float]:
    """Return the width of a line and its reach above and below the baseline, in multiples of its size."""
    font_properties = font(_MEASURED, bold=bold, wide=is_wide(text))
    width, height, below = text_to_path.get_text_width_height_descent(text, font_properties, ismath=False)
    return width / _MEASURED, (height - below) / _MEASURED, below / _MEASURED


def fitted(text: str, size: float, room: float, cut: Callable[[str, int], str] = shorten) -> str:
    """Return the printable text cut to `room` px, by default at its middle."""
    whole = one_line(text)
    if text_width(whole, size) <= room:
        return whole
    low, high = 1, len(whole)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if text_width(cut(whole, middle), size) <= room else (low, middle)
    return cut(whole, low)


def fitted_all(texts: Sequence[str], size: float, room: float) -> list[str]:
    """Return the texts cut to `room` px at their middle, beginning or end, whichever keeps all of them different.

    If none does, they are cut to a number of characters that keeps them different.
    """
    wholes = [one_line(text) for text in texts]
    best: list[str] = []
    for cut in (shorten, ending, beginning):
        labels = [fitted(text, size, room, cut) for text in wholes]
        if len(set(labels)) == len(set(wholes)):
            return labels
        best = max(best, labels, key=lambda names: len(set(names)))
    return _fit_apart(wholes, size, room) or best


def _fit_apart(texts: Sequence[str], size: float, room: float) -> list[str]:
    """Return the texts in as many characters as fit, [] if these are too few to keep the texts different."""
    best: list[str] = []
    low, high = _FEWEST, max(map(len, texts), default=0)
    while low <= high:
        middle = (low + high) // 2
        labels = shorten_apart(texts, middle)
        if all(text_width(label, size) <= room for label in labels.values()):
            best, low = [labels[text] for text in texts], middle + 1
        else:
            high = middle - 1
    return best


def balanced(text: str, size: float, room: float) -> tuple[str, ...]:
    """Return the printable text in as few lines as `room` px allow, all about equally wide.

    There are no lines if a word would have to be broken.
    """
    lines = wrapped(text, size, room, anywhere=False)
    low, high = room / max(1, len(lines)), room
    while len(lines) > 1 and high - low > 1:
        middle = (low + high) / 2
        narrower = wrapped(text, size, middle, anywhere=False)
        low, high, lines = (low, middle, narrower) if len(narrower) == len(lines) else (middle, high, lines)
    return lines


def wrapped(text: str, size: float, room: float, *, bold: bool = False, anywhere: bool = True) -> tuple[str, ...]:
    """Return the printable text in lines of at most `room` px, broken after "_", "-", "/", "." or a space.

    A wider piece is broken within itself if `anywhere` is set; else there are no lines.
    """
    lines, line = [], ""
    for piece in _pieces(one_line(text)):
        if line and text_width((line + piece).rstrip(), size, bold=bold) > room:
            lines.append(line)
            line = ""
        line += piece
        while len(line) > 1 and text_width(line.rstrip(), size, bold=bold) > room:
            if not anywhere:
                return ()
            keep = _prefix(line, size, room, bold=bold)
            lines.append(line[:keep])
            line = line[keep:]
    return tuple(stripped for stripped in (entry.strip() for entry in (*lines, line)) if stripped)


def _prefix(line: str, size: float, room: float, *, bold: bool) -> int:
    low, high = 1, len(line)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if text_width(line[:middle], size, bold=bold) <= room else (low, middle)
    return low


def _pieces(text: str) -> list[str]:
    pieces = [""]
    for char in text:
        pieces[-1] += char
        if char in _BREAKS:
            pieces.append("")
    return [piece for piece in pieces if piece] or [""]


@lru_cache(maxsize=1)
def _families() -> tuple[str, ...]:
    """Return the installed families. Fonts installed after matplotlib listed its fonts are added to its list."""
    installed = {entry.name for entry in fontManager.ttflist}
    return (_FIRST, *(family for family, files in _WIDER.items() if family in installed or sum(map(_add_font, files))))


def _add_font(file: str) -> bool:
    try:
        fontManager.addfont(str(ImageFont.truetype(file).path))
    except (OSError, RuntimeError):
        return False
    return True
