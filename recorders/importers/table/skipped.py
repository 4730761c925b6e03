"""Rows that could not be imported, counted and listed by their line numbers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from hrclog.diagnostic import Diagnostic
from hrclog.wording import agree, counted

_MOST_RANGES: Final = 60  # that a message lists


@dataclass(frozen=True, slots=True)
class Skip:
    """A row that was left out: its line in the file, and why."""

    line: int
    reason: str


def skip_diagnostics(path: Path, skips: Sequence[Skip]) -> list[Diagnostic]:
    """Return a diagnostic of all rows of a file that were skipped: by reason, with their lines."""
    if not skips:
        return []
    by_reason: dict[str, list[int]] = {}
    for skip in skips:
        by_reason.setdefault(skip.reason, []).append(skip.line)
    reasons = [
        f"{reason} ({agree(len(lines), 'line', 'lines')} {lines_text(lines)})" for reason, lines in by_reason.items()
    ]
    return [Diagnostic("skipped_row", f"{counted(len(skips), 'row')} skipped: {'; '.join(reasons)}", str(path))]


def lines_text(lines: Sequence[int]) -> str:
    """Return line numbers as ranges: "4, 7-9"."""
    ranges: list[tuple[int, int]] = []
    for line in sorted(set(lines)):
        if ranges and line == ranges[-1][1] + 1:
            ranges[-1] = (ranges[-1][0], line)
        else:
            ranges.append((line, line))
    shown = [str(first) if first == last else f"{first}-{last}" for first, last in ranges[:_MOST_RANGES]]
    others = sum(last - first + 1 for first, last in ranges[_MOST_RANGES:])
    return ", ".join(shown) + (f" and {others:,} more" if others else "")


def skip_values(path: Path, skips: Iterable[Skip]) -> list[dict[str, Any]]:
    """Return the rows for JSON, in order of their lines."""
    ordered = sorted(skips, key=lambda skip: (skip.line, skip.reason))
    return [{"file": str(path), "line": skip.line, "reason": skip.reason} for skip in ordered]
