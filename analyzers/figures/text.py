"""Names as labels: printable, short enough to be drawn, and unlike each other."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

UNNAMED: Final = "(unnamed)"
_UNPRINTABLE: Final = ("Cc", "Cf", "Cs", "Co", "Zl", "Zp")
_JOINERS: Final = "\u200c\u200d"
_MARKDOWN: Final = str.maketrans({char: f"\\{char}" for char in "\\`*_{}[]<>()#+!|~$&"})


def printable(text: str) -> str:
    """Return the text on one line, control and direction characters shown as "·", UNNAMED if nothing is left.

    Joiners stay within scripts and emoji that need them; in ASCII they would be differences that nobody sees.
    """
    shown = text
    if not text.isprintable():
        shown = "".join(_printable_at(text, at) for at in range(len(text)))
    return " ".join(shown.split()) or UNNAMED


def _printable_at(text: str, at: int) -> str:
    char = text[at]
    if unicodedata.category(char) not in _UNPRINTABLE:
        return char
    sides = text[max(at - 1, 0) : at], text[at + 1 : at + 2]
    joins = char in _JOINERS and all(side.isprintable() and not side.isascii() for side in sides)
    return char if joins else "·"


def shorten(text: str, width: int) -> str:
    """Return the printable text in at most `width` characters; an ellipsis stands for its middle.

    The middle goes, because long names tend to share their beginning and differ in their end.
    """
    shown = printable(text)
    if len(shown) <= width:
        return shown
    tail = (width - 1) // 3
    return f"{shown[: width - 1 - tail]}…{shown[len(shown) - tail :]}"


def ending(text: str, width: int) -> str:
    """Return the printable text in at most `width` characters; an ellipsis stands for its beginning."""
    shown = printable(text)
    return shown if len(shown) <= width else f"…{shown[len(shown) - width + 1 :]}"


def beginning(text: str, width: int) -> str:
    """Return the printable text in at most `width` characters; an ellipsis stands for its end."""
    shown = printable(text)
    return shown if len(shown) <= width else f"{shown[: width - 1]}…"


def shorten_apart(names: Iterable[str], width: int) -> dict[str, str]:
    """Return a label of at most `width` characters per name: names that are printed unlike have labels unlike.

    All are cut at their middle, beginning or end, whichever keeps most of them apart. Those that are alike even so show
    where they begin to differ, and those that differ in their length only have a number. Short names stay as they are.

    Args:
        names: in any order, which does not matter.
        width: 8 or more, so that there is room for numbers.
    """
    shown = {name: printable(name) for name in names}
    texts = sorted(set(shown.values()))
    cuts = [{text: cut(text, width) for text in texts} for cut in (shorten, ending, beginning)]
    best = max(cuts, key=lambda labels: len(set(labels.values())))
    for alike in _alike({text: label for text, label in best.items() if text != label}):
        best |= _where_they_differ(alike, width)
    labels = _numbered(best, width)
    return {name: labels[text] for name, text in shown.items()}


def _alike(labels: Mapping[str, str]) -> list[list[str]]:
    """Return the texts of each label that several have."""
    texts: dict[str, list[str]] = {}
    for text, label in labels.items():
        texts.setdefault(label, []).append(text)
    return [group for group in texts.values() if len(group) > 1]


def _where_they_differ(texts: Sequence[str], width: int) -> dict[str, str]:
    """Return labels of long texts in which the first characters that differ are seen."""
    labels: dict[str, str] = {}
    waiting = [texts]
    while waiting:
        group = waiting.pop()
        place = _first_difference(min(group), max(group))
        found = {text: _with(text, place, width) for text in group}
        labels |= found
        waiting += [alike for alike in _alike(found) if len(alike) < len(group)]
    return labels


def _first_difference(one: str, other: str) -> int:
    pairs = enumerate(zip(one, other, strict=False))
    return next((at for at, (char, its) in pairs if char != its), min(len(one), len(other)))


def _with(text: str, place: int, width: int) -> str:
    """Return the beginning of a long text and what it has from a place on."""
    head = (width - 1) // 3
    room = width - head - 1
    if place <= head + 1:
        return beginning(text, width)
    return f"{text[:head]}…{beginning(text[min(place, len(text) - room) :], room)}"


def _numbered(labels: Mapping[str, str], width: int) -> dict[str, str]:
    """Return the labels with a number at the end of those that another text has already, uncut ones as they are."""
    taken: dict[str, str] = {}
    for text in sorted(labels, key=lambda text: (text != labels[text], text)):
        label, count = labels[text], 1
        while label in taken:
            count += 1
            number = f"({count})"
            label = labels[text][: width - len(number)] + number
        taken[label] = text
    return {text: label for label, text in taken.items()}


def markdown_escape(text: str) -> str:
    """Return the text so that a markdown cell shows it as it is; "" stays ""."""
    return printable(text).translate(_MARKDOWN) if text else ""
