"""Fonts that have the characters of a text, and how wide it is in them."""

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
"""The height of a line, in sizes of its text."""
RISE: Final = 0.36
"""How far the middle of a line lies above its baseline, in sizes of its text."""

_FIRST: Final = "DejaVu Sans"  # matplotlib carries it
# families and the files that each is found by; none is required
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
    """Return the printable text of one or more lines, less two characters that XML forbids."""
    return "\n".join(map(one_line, text.splitlines()))


def one_line(text: str) -> str:
    """Return the printable text, less two characters that XML forbids."""
    return printable(text.translate(_FORBIDDEN))


@lru_cache(maxsize=256)
def font(points: float, *, bold: bool, wide: bool) -> FontProperties:
    """Return the font of a size; a `wide` one looks for each glyph in the system's fonts too."""
    return FontProperties(
        family=list(_families() if wide else (_FIRST,)), size=points, weight="bold" if bold else "normal"
    )


@lru_cache(maxsize=20_000)
def is_wide(text: str) -> bool:
    """Tell whether a text has characters that DejaVu Sans lacks."""
    return not text.isascii() and any(not _plain().get_char_index(ord(char)) for char in text)


@lru_cache(maxsize=1)
def _plain() -> FT2Font:
    return get_font(findfont(font(_MEASURED, bold=False, wide=False)))


def text_width(text: str, size: float, *, bold: bool = False) -> float:
    """Return the width of a line in px."""
    return _measured(text, bold=bold)[0] * size


def text_reach(text: str, size: float, *, bold: bool = False) -> tuple[float, float]:
    """Return the px that a line takes above and below its middle: half a line's height, or more for tall signs."""
    _, above, below = _measured(text, bold=bold)
    return max(LINE / 2, above - RISE) * size, max(LINE / 2, below + RISE) * size


@lru_cache(maxsize=20_000)
def _measured(text: str, *, bold: bool) -> tuple[float, float, float]:
    """Return the width of a line and how far it reaches above and below its baseline, in sizes."""
    written = font(_MEASURED, bold=bold, wide=is_wide(text))
    width, height, below = text_to_path.get_text_width_height_descent(text, written, ismath=False)
    return width / _MEASURED, (height - below) / _MEASURED, below / _MEASURED


def fitted(text: str, size: float, room: float, cut: Callable[[str, int], str] = shorten) -> str:
    """Return the printable text, as much of it left out as `room` px ask for: by default of its middle."""
    shown = one_line(text)
    if text_width(shown, size) <= room:
        return shown
    low, high = 1, len(shown)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if text_width(cut(shown, middle), size) <= room else (low, middle)
    return cut(shown, low)


def fitted_all(texts: Sequence[str], size: float, room: float) -> list[str]:
    """Return the texts cut to `room` px at their middle, beginning or end, whichever tells all of them apart.

    If none does, they are cut to a number of characters in which they can be told apart.
    """
    wholes = [one_line(text) for text in texts]
    best: list[str] = []
    for cut in (shorten, ending, beginning):
        shown = [fitted(text, size, room, cut) for text in wholes]
        if len(set(shown)) == len(set(wholes)):
            return shown
        best = max(best, shown, key=lambda names: len(set(names)))
    return _fitted_apart(wholes, size, room) or best


def _fitted_apart(texts: Sequence[str], size: float, room: float) -> list[str]:
    """Return the texts in as many characters as fit, nothing if these are too few to tell them apart."""
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
    """Return the printable text in as few lines as `room` px allow, about as wide as each other.

    There are no lines if it would have to be broken within a word.
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

    A piece that is wider is broken `anywhere`; else, there are no lines.
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
    return tuple(shown for shown in (said.strip() for said in (*lines, line)) if shown)


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
    """Return the families that are there; what was installed after matplotlib listed the fonts is added to its list."""
    known = {entry.name for entry in fontManager.ttflist}
    return (_FIRST, *(family for family, files in _WIDER.items() if family in known or sum(map(_added, files))))


def _added(file: str) -> bool:
    try:
        fontManager.addfont(str(ImageFont.truetype(file).path))
    except (OSError, RuntimeError):
        return False
    return True
