"""What the names of recipes say, which are the names of the runs in the dumps of the paper's authors."""

from __future__ import annotations

import re
from typing import Final

_RECIPE: Final = re.compile(r"(?P<planner>.+?)_rec_\d+_rep_\d+_(?P<session>.+)", re.DOTALL)


def planner_and_session(name: str) -> tuple[str, str] | None:
    """Return which planner made a recipe, and what follows the repetition in its name; None if it is no such name.

    An example is BASIC_SOLVER_rec_12_rep_0_2023_07_19_12:08_14.
    """
    match = _RECIPE.fullmatch(name)
    return (match["planner"], match["session"]) if match else None
