"""Names as labels: printable, short enough to draw, and different from each other."""

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

    Joiners are kept in scripts and emoji that need them. In ASCII they would be invisible differences.
    """
    printed = text
    if not text.isprintable():
        printed = "".join(_printable_at(text, at) for at in range(len(text)))
    return " ".join(printed.split()) or UNNAMED


def _printable_at(text: str, at: int) -> str:
    char = text[at]
    if unicodedata.category(char) not in _UNPRINTABLE:
        return char
    sides = text[max(at - 1, 0) : at], text[at + 1 : at + 2]
    joins = char in _JOINERS and all(side.isprintable() and not side.isascii() for side in sides)
    return char if joins else "·"


def shorten(text: str, width: int) -> str:
    """Return the printable text in at most `width` characters; an ellipsis stands for its middle.

    The middle is cut, because long names often share their beginning and differ at their end.
    """
    printed = printable(text)
    if len(printed) <= width:
        return printed
    tail = (width - 1) // 3
    return f"{printed[: width - 1 - tail]}…{printed[len(printed) - tail :]}"


def ending(text: str, width: int) -> str:
    """Return the printable text in at most `width` characters; an ellipsis stands for its beginning."""
    printed = printable(text)
    return printed if len(printed) <= width else f"…{printed[len(printed) - width + 1 :]}"


def beginning(text: str, width: int) -> str:
    """Return the printable text in at most `width` characters; an ellipsis stands for its end."""
    printed = printable(text)
    return printed if len(printed) <= width else f"{printed[: width - 1]}…"


def shorten_apart(names: Iterable[str], width: int) -> dict[str, str]:
    """Return a label of at most `width` characters per name: names that print differently have different labels.

    All names are cut at their middle, beginning or end, whichever keeps most labels different. Labels that are still
    equal show where the names begin to differ. Names that differ only in length get a number. Short names are kept.

    Args:
        names: in any order; the result does not depend on it.
        width: 8 or more, so that there is room for numbers.
    """
    printed = {name: printable(name) for name in names}
    texts = sorted(set(printed.values()))
    cuts = [{text: cut(text, width) for text in texts} for cut in (shorten, ending, beginning)]
    best = max(cuts, key=lambda labels: len(set(labels.values())))
    for alike in _group_alike({text: label for text, label in best.items() if text != label}):
        best |= _labels_at_difference(alike, width)
    labels = _number_duplicates(best, width)
    return {name: labels[text] for name, text in printed.items()}


def _group_alike(labels: Mapping[str, str]) -> list[list[str]]:
    """Return the groups of texts that share a label."""
    texts: dict[str, list[str]] = {}
    for text, label in labels.items():
        texts.setdefault(label, []).append(text)
    return [group for group in texts.values() if len(group) > 1]


def _labels_at_difference(texts: Sequence[str], width: int) -> dict[str, str]:
    """Return labels of long texts that show the first characters in which the texts differ."""
    labels: dict[str, str] = {}
    waiting = [texts]
    while waiting:
        group = waiting.pop()
        place = _first_difference(min(group), max(group))
        cut_labels = {text: _skip_to(text, place, width) for text in group}
        labels |= cut_labels
        waiting += [alike for alike in _group_alike(cut_labels) if len(alike) < len(group)]
    return labels


def _first_difference(first: str, second: str) -> int:
    pairs = enumerate(zip(first, second, strict=False))
    return next((index for index, (char, other_char) in pairs if char != other_char), min(len(first), len(second)))


def _skip_to(text: str, place: int, width: int) -> str:
    """Return the beginning of a long text, an ellipsis, and the text from a place on."""
    head = (width - 1) // 3
    room = width - head - 1
    if place <= head + 1:
        return beginning(text, width)
    return f"{text[:head]}…{beginning(text[min(place, len(text) - room) :], room)}"


def _number_duplicates(labels: Mapping[str, str], width: int) -> dict[str, str]:
    """Return the labels, with a number at the end of those that are taken already. Uncut labels are kept."""
    text_by_label: dict[str, str] = {}
    for text in sorted(labels, key=lambda text: (text != labels[text], text)):
        label, count = labels[text], 1
        while label in text_by_label:
            count += 1
            number = f"({count})"
            label = labels[text][: width - len(number)] + number
        text_by_label[label] = text
    return {text: label for label, text in text_by_label.items()}


def markdown_escape(text: str) -> str:
    """Return the text escaped for a markdown cell; "" stays ""."""
    return printable(text).translate(_MARKDOWN) if text else ""
