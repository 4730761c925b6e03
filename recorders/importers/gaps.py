"""Which attempts a dump hides: gaps in the trailing counter of recipe names.

The authors' stack deletes a failed recipe and runs it again under the next number, so a missing number hints at a
deleted attempt. Recipes are numbered within a session: what stands before the repetition and the time of its start.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

_RECIPE: Final = re.compile(r"^(?P<planner>.+?)_rec_\d+_rep_\d+_(?P<session>.+)_(?P<counter>\d+)$")
_COUNTER: Final = re.compile(r"^(?P<planner>.*?)_?(?P<counter>\d+)$")


@dataclass(frozen=True, slots=True)
class Gap:
    """One planner's attempts: how many there were, how many are missing."""

    prefix: str
    n_attempts: int
    n_missing: int


def gap_report(recipes: Iterable[str]) -> list[Gap]:
    """Return one row per planner prefix, sorted; attempts = largest - smallest counter + 1 of each session.

    Names without a counter take no part.
    """
    counters: dict[tuple[str, str], set[int]] = {}
    for recipe in recipes:
        match = _RECIPE.match(recipe) or _COUNTER.match(recipe)
        if match:
            session = match.groupdict().get("session", "")
            counters.setdefault((match["planner"], session), set()).add(int(match["counter"]))
    totals: dict[str, tuple[int, int]] = {}
    for (planner, _), numbers in counters.items():
        attempts = max(numbers) - min(numbers) + 1
        known, missing = totals.get(planner, (0, 0))
        totals[planner] = (known + attempts, missing + attempts - len(numbers))
    return [Gap(planner, *totals[planner]) for planner in sorted(totals)]
