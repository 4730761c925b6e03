"""How far a clock is ahead, as a text that commands take and diagnostics print: +3600s, -250ms."""

from __future__ import annotations

import re
from decimal import Decimal
from operator import index
from typing import Final, SupportsIndex

from hrclog.units import NS_PER_S

_NS_OF_UNIT: Final = {
    "ns": 1,
    "us": 10**3,
    "µs": 10**3,
    "ms": 10**6,
    "s": NS_PER_S,
    "min": 60 * NS_PER_S,
    "h": 3600 * NS_PER_S,
    "d": 86_400 * NS_PER_S,
}
_OFFSET: Final = re.compile(rf"([+-]?)(\d+(?:\.\d+)?|\.\d+)\s*({'|'.join(_NS_OF_UNIT)})", re.ASCII)
_LARGEST_NS: Final = 2**61

OFFSET_FORM: Final = f"a number and one of {', '.join(_NS_OF_UNIT)}, for example +3600s or -250ms"


def parse_offset(text: str) -> int:
    """Return an offset in ns.

    Raises:
        ValueError: the text is none, or more than 73 years.
    """
    parts = _OFFSET.fullmatch(text.strip())
    if parts is None:
        raise ValueError(f"found {text!r}, expected {OFFSET_FORM}")
    sign, number, unit = parts.groups()
    offset_ns = int((Decimal(number) * _NS_OF_UNIT[unit]).to_integral_value())
    if offset_ns > _LARGEST_NS:
        raise ValueError(f"found {text!r}, expected less than 73 years")
    return -offset_ns if sign == "-" else offset_ns


def checked_offset(offset: object) -> int:
    """Return an offset in ns that a caller gave as that, or as a text.

    Raises:
        ValueError: it is neither, or more than 73 years.
    """
    if isinstance(offset, str):
        return parse_offset(offset)
    if not isinstance(offset, SupportsIndex) or isinstance(offset, bool) or abs(index(offset)) > _LARGEST_NS:
        raise ValueError(f"found {offset!r}, expected whole ns within 73 years, or {OFFSET_FORM}")
    return index(offset)


def offset_text(offset_ns: int) -> str:
    """Return an offset as `parse_offset` reads it, exact to the nanosecond."""
    return f"{seconds_text(offset_ns)}s"


def seconds_text(offset_ns: int) -> str:
    """Return signed seconds without needless zeros: +3600, -0.25."""
    whole, fraction = divmod(abs(offset_ns), NS_PER_S)
    digits = f"{fraction:09d}".rstrip("0")
    return f"{'-' if offset_ns < 0 else '+'}{whole}{'.' if digits else ''}{digits}"
