"""Names as labels: printable, and short enough to be drawn."""

from __future__ import annotations

import unicodedata
from typing import Final

UNNAMED: Final = "(unnamed)"
_UNPRINTABLE: Final = ("Cc", "Cf", "Cs", "Co", "Zl", "Zp")
_MARKDOWN: Final = str.maketrans({char: f"\\{char}" for char in "\\`*_{}[]<>()#+!|~$"})


def printable(text: str) -> str:
    """Return the text on one line, control and direction characters shown as "·", UNNAMED if nothing is left."""
    shown = text
    if not text.isprintable():
        shown = "".join("·" if unicodedata.category(char) in _UNPRINTABLE else char for char in text)
    return " ".join(shown.split()) or UNNAMED


def shorten(text: str, width: int) -> str:
    """Return the printable text in at most `width` characters; an ellipsis stands for its middle.

    The middle goes, because long names tend to share their beginning and differ in their end.
    """
    shown = printable(text)
    if len(shown) <= width:
        return shown
    tail = (width - 1) // 3
    return f"{shown[: width - 1 - tail]}…{shown[len(shown) - tail :]}"


def markdown_escape(text: str) -> str:
    """Return the text so that a markdown cell shows it as it is; "" stays ""."""
    return printable(text).translate(_MARKDOWN) if text else ""
