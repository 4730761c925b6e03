"""The inputs of a run, for every executor. They give its opening fact and its dispatcher."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from hrclog._version import __version__
from hrclog.planning.dispatch_mode import DispatchMode, schedule_of
from hrclog.planning.plan import Plan, check_plan
from hrclog.planning.problem import Problem
from hrclog.planning.run_state import Replan
from hrclog.recorders.dispatch.policy import DispatchPolicy


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSetup:
    """Who does what, and by which rules.

    Attributes:
        plan: what to do.
        problem: the tasks there are.
        policy: mode, retries, limits.
        seed: of whatever is random in the executors; None if nothing is.
        software: versions by name, besides that of hrclog.
        replan: asked for another plan when the policy says so; None: nobody is asked.
        tags: facts of the run, by key.
    """

    plan: Plan
    problem: Problem
    policy: DispatchPolicy = field(default_factory=DispatchPolicy)
    seed: int | None = None
    software: Mapping[str, str] = field(default_factory=dict)
    replan: Replan | None = None
    tags: Mapping[str, str] = field(default_factory=dict)

    def check(self) -> None:
        """Raise if the plan cannot be carried out.

        Raises:
            ScenarioError: the plan does not solve the problem, or not in this mode.
        """
        check_plan(self.problem, self.plan)
        schedule_of(self.plan, DispatchMode(self.policy.mode), self.problem)

    def facts(self) -> dict[str, Any]:
        """Return what `run_started` says of the run, as its fields."""
        return {
            "agents": self.problem.agents,
            "plan": self.plan.to_json(),
            "task_properties": self.problem.to_json()["tasks"],
            "dispatch_mode": str(self.policy.mode),
            "software": {"hrclog": __version__, **self.software},
            "seed": self.seed,
            "tags": dict(self.tags),
        }
