"""What kind of plan is wanted, and how to look for it."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from hrclog.analyzers.search.judge import Objective
from hrclog.analyzers.search.local_search import Effort
from hrclog.errors import HrclogError
from hrclog.knowledge.task_times import AgentTask


class Method(StrEnum):
    """How a plan is looked for.

    AUTO: all plans if they are few, else local search. ENUMERATE: all plans. LOCAL: local search. CPSAT: constraint
    programming, which also proves a bound. BASELINE: the least makespan by mean durations alone, one of the equally
    good plans by chance. NOT_NEIGHBORING: pairs that hinder each other as little as possible side by side, then as
    baseline. RANDOM: any plan, by chance.
    """

    AUTO = "auto"
    ENUMERATE = "enumerate"
    LOCAL = "local"
    CPSAT = "cpsat"
    BASELINE = "baseline"
    NOT_NEIGHBORING = "not-neighboring"
    RANDOM = "random"


@dataclass(frozen=True, slots=True)
class Wish:
    """What kind of plan is wanted.

    Attributes:
        objective: of the makespan.
        method: how to look for it.
        seed: of all that is left to chance.
        effort: how long local search and constraint programming may take.
        avoid: pairs for `not-neighboring`; None for those that are known to hinder each other.
        explore: whether to plan as if one draw of what is known were true, so that now and then pairs are tried of
            which little is known (Thompson 1933).

    Raises:
        HrclogError: the objective or the method is not known.
    """

    objective: Objective = Objective.MEAN
    method: Method = Method.AUTO
    seed: int = 0
    effort: Effort = field(default_factory=Effort)
    avoid: tuple[tuple[AgentTask, AgentTask], ...] | None = None
    explore: bool = False

    def __post_init__(self) -> None:
        for name, kind in (("objective", Objective), ("method", Method)):
            if getattr(self, name) not in tuple(kind):
                raise HrclogError(f"{name}: found {getattr(self, name)!r}, expected one of {', '.join(kind)}")
