"""How a plan can be looked for, and what can be small: a record each, light enough for a help text."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class MethodRecord:
    """A way to look for a plan.

    Attributes:
        name: by which it is chosen.
        summary: what it does.
        by_mean_durations: whether it looks for the least makespan by mean durations, whatever the objective.
    """

    name: str
    summary: str
    by_mean_durations: bool = False


@dataclass(frozen=True, slots=True)
class ObjectiveRecord:
    """What is to be small.

    Attributes:
        name: by which it is chosen.
        summary: what it is.
    """

    name: str
    summary: str


METHODS: Final = {
    record.name: record
    for record in (
        MethodRecord("auto", "`enumerate` up to 2,000 plans, `local` beyond"),
        MethodRecord("enumerate", "judges all plans"),
        MethodRecord(
            "local",
            "iterated local search in the world where everything is as expected, by `--effort` plans; the 64 best are "
            "judged by all worlds",
        ),
        MethodRecord("cpsat", "OR-Tools, in the expected world; tells a bound of its own. No due times"),
        MethodRecord(
            "baseline",
            "the least makespan by mean durations, as if nobody mattered to anybody; one of the equally good plans by "
            "`--seed`",
            by_mean_durations=True,
        ),
        MethodRecord(
            "not-neighboring",
            "pairs that hinder each other (or those of `--avoid`) as little as possible side by side, then as "
            "`baseline`",
            by_mean_durations=True,
        ),
        MethodRecord("random", "any plan"),
    )
}
"""By name; the first, which chooses another, is the default."""

OBJECTIVES: Final = {
    record.name: record
    for record in (
        ObjectiveRecord("mean", "its expectation"),
        ObjectiveRecord("p95", "what 95 % of runs stay below"),
        ObjectiveRecord("closed-form", "the paper's closed form"),
    )
}
"""By name; the first is the default."""
