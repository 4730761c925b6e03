"""Place bars that overlap in as few rows as possible."""

from __future__ import annotations

from collections.abc import Sequence


def lane_numbers(spans: Sequence[tuple[int, int]]) -> list[int]:
    """Return for each half-open span (start, end), sorted by start, the first row in which it overlaps none."""
    ends: list[int] = []
    rows: list[int] = []
    for start, end in spans:
        row = next((row for row, free_from in enumerate(ends) if free_from <= start), len(ends))
        ends[row : row + 1] = [end]
        rows.append(row)
    return rows
