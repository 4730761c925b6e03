"""Colours that colour-blind people can tell apart. Data colours are the same on dark and light backgrounds."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Final, Literal

Color = tuple[int, int, int]

Role = Literal["card", "ink", "muted", "grid", "unobserved"]
"""A colour that depends on the theme: background, text, secondary text, lines, and a cell without a value."""

Paint = Color | Role

CARD: Final[Color] = (22, 25, 29)
INK: Final[Color] = (226, 230, 235)
MUTED: Final[Color] = (139, 147, 158)
GRID: Final[Color] = (54, 60, 68)
UNOBSERVED: Final[Color] = (62, 68, 76)
WHITE: Final[Color] = (255, 255, 255)

DARK: Final[Mapping[Role, Color]] = {
    "card": CARD,
    "ink": INK,
    "muted": MUTED,
    "grid": GRID,
    "unobserved": UNOBSERVED,
}
LIGHT: Final[Mapping[Role, Color]] = {
    "card": (255, 255, 255),
    "ink": (31, 35, 40),
    "muted": (97, 105, 115),
    "grid": (220, 224, 229),
    "unobserved": (222, 225, 229),
}

FAILED: Final[Color] = (213, 94, 0)
PAUSED: Final[Color] = (112, 118, 128)
OPEN: Final[Color] = (150, 156, 166)
REDUCED: Final[Color] = (230, 159, 0)
FULL_SPEED: Final[Color] = (0, 128, 104)

# 17 or more apart (CIE 1976) from each other and from the colours above, for normal, protan and deutan eyes alike
TASKS: Final[tuple[Color, ...]] = (
    (0, 114, 178),
    (190, 140, 100),
    (60, 60, 190),
    (221, 204, 119),
    (86, 180, 233),
    (116, 84, 52),
    (250, 240, 120),
    (100, 60, 90),
    (215, 190, 170),
    (51, 34, 136),
)

MARK: Final[Color] = (86, 180, 233)
"""The colour of marks that need no other: boxes, and dots of single values."""

# Okabe and Ito (2008) and Tol (2021), those that stand out on dark and on light ground
LINES: Final[tuple[Color, ...]] = (
    (0, 114, 178),
    (213, 94, 0),
    (0, 158, 115),
    (204, 121, 167),
    (86, 180, 233),
    (153, 153, 51),
    (125, 107, 196),
    (136, 34, 85),
)

_DIVERGING: Final[tuple[Color, ...]] = ((33, 102, 172), (103, 169, 207), (240, 240, 240), (239, 138, 71), (179, 73, 10))
_SEQUENTIAL: Final[tuple[Color, ...]] = ((0, 32, 76), (66, 78, 108), (124, 123, 120), (188, 175, 111), (255, 234, 70))


def diverging(position: float) -> Color:
    """Return blue at -1, near white at 0, orange at 1; beyond is clipped."""
    return _ramp(_DIVERGING, (position + 1) / 2)


def sequential(position: float) -> Color:
    """Return dark blue at 0, yellow at 1 (after cividis); beyond is clipped."""
    return _ramp(_SEQUENTIAL, position)


def blend(color: Color, other: Color, share: float) -> Color:
    """Return the colour moved towards another by a share of 0 to 1."""
    red, green, blue = (round(a + (b - a) * share) for a, b in zip(color, other, strict=True))
    return red, green, blue


def ink_on(color: Color) -> Color:
    """Return the text colour that reads best on a fill (by ITU-R BT.601 luma)."""
    red, green, blue = color
    return CARD if 0.299 * red + 0.587 * green + 0.114 * blue > 130 else WHITE


def task_colors(tasks: Iterable[str]) -> dict[str, Color]:
    """Return a colour per task name: mostly the same in every run, and none twice while there are enough colours."""
    colors: dict[str, Color] = {}
    used_slots: set[int] = set()
    for task in sorted(set(tasks)):
        if len(used_slots) == len(TASKS):
            used_slots.clear()
        slot = zlib.crc32(task.encode("utf-8", "surrogatepass")) % len(TASKS)
        while slot in used_slots:
            slot = (slot + 1) % len(TASKS)
        used_slots.add(slot)
        colors[task] = TASKS[slot]
    return colors


def _ramp(stops: Sequence[Color], position: float) -> Color:
    scaled = min(max(position, 0.0), 1.0) * (len(stops) - 1)
    index = min(int(scaled), len(stops) - 2)
    low, high = list(pairwise(stops))[index]
    return blend(low, high, scaled - index)
