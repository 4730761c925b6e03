"""Find attempts that a dump lacks: gaps in the trailing counter of recipe names.

The authors' stack deletes a failed recipe and runs it again under the next number, so a missing number hints at a
deleted attempt. Recipes are numbered within a session: what stands before the repetition and the time of its start.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from hrclog.recipe_names import planner_and_session

_DIGITS: Final = "0123456789"
_LONGEST_COUNTER: Final = 9  # digits; a longer number is a time or an id


@dataclass(frozen=True, slots=True)
class Gap:
    """One planner's attempts: how many there were, how many are missing."""

    prefix: str
    n_attempts: int
    n_missing: int


def gap_report(recipes: Iterable[str]) -> list[Gap]:
    """Return one row per planner prefix, sorted; attempts = largest - smallest counter + 1 of each session.

    Names without a counter are ignored.
    """
    counters: dict[tuple[str, str], set[int]] = {}
    for recipe in recipes:
        name = recipe.rstrip(_DIGITS)
        counter = recipe[len(name) :]
        if 0 < len(counter) <= _LONGEST_COUNTER:
            stem = name.removesuffix("_")
            counters.setdefault(planner_and_session(stem) or (stem, ""), set()).add(int(counter))
    totals: dict[str, tuple[int, int]] = {}
    for (planner, _), numbers in counters.items():
        attempts = max(numbers) - min(numbers) + 1
        n_attempts, n_missing = totals.get(planner, (0, 0))
        totals[planner] = (n_attempts + attempts, n_missing + attempts - len(numbers))
    return [Gap(planner, *totals[planner]) for planner in sorted(totals)]
