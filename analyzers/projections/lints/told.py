"""How lints tell instants, lengths of time and lists."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Final

_MOST_LISTED: Final = 3
_UNITS: Final = ((86_400.0, "d"), (3600.0, "h"), (60.0, "min"), (1.0, "s"), (1e-3, "ms"), (1e-6, "us"))


def utc(time_ns: int) -> str:
    """Return an instant as a date and a time of day; ns where it has none."""
    try:
        return datetime.fromtimestamp(time_ns / 1e9, UTC).strftime("%Y-%m-%d %H:%M:%S")
    except (OverflowError, ValueError, OSError):
        return f"{time_ns} ns"


def length(seconds: float) -> str:
    """Return a length of time in seconds, and in the unit that suits it where that is another."""
    if 1e-3 <= abs(seconds) < 3600:
        return f"{seconds:.3f} s"
    size, unit = next(((size, unit) for size, unit in _UNITS if abs(seconds) >= size), (1e-9, "ns"))
    return f"{seconds:.15g} s ({seconds / size:.3g} {unit})"


def listed(texts: Sequence[str], most: int = _MOST_LISTED) -> str:
    """Return the first of some texts, and how many more there are."""
    shown = ", ".join(texts[:most])
    return f"{shown} and {len(texts) - most:,} more" if len(texts) > most else shown
