"""The goals of one action, from whatever evidence there is of them: acceptance, begin, end, goal and result."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Final

from hrclog.events import CommandRejected, Outcome, TaskDispatched, TaskEnded, TaskStarted, event_on
from hrclog.recorders.mapping.facts import Fact, Instant, Notes
from hrclog.recorders.mapping.values import Value


@dataclass(frozen=True, slots=True)
class End:
    """How and when a goal ended."""

    outcome: str
    at: Instant
    reason: str = ""


@dataclass(slots=True)
class Goal:
    """What is known of a goal, and how much of it was told.

    Attributes:
        execution_id: of its execution.
        stamp_ns: when the server says that it took it.
        agent: "" until it is known.
        task: "" until it is known.
        accepted: when the server took it.
        started: when it began.
        likely_start: when it began, if nothing better is known; `likely_text` says how that is known.
        end: by the source that counts.
        likely_end: by another source.
        reason: why it ended so, None until the result is there.
    """

    execution_id: str
    agent: str = ""
    task: str = ""
    accepted: Instant | None = None
    started: Instant | None = None
    likely_start: Instant | None = None
    end: End | None = None
    likely_end: End | None = None
    reason: str | None = None
    rejected: CommandRejected | None = None
    left_out: bool = False
    stamp_ns: int | None = None
    n_told: int = 0
    seen: set[int] = field(default_factory=set)


@dataclass(slots=True)
class Goals:
    """The goals of an action.

    Attributes:
        agent: what an agent is called whose goal was not recorded.
        task: what a task is called whose goal was not recorded.
        tells_fallbacks: whether that is worth a remark, as the mapping does not say so.
        waits_for_reason: whether the end is told only when the result is there.
        name: of the action.
        undefined: the type of recorded goals of which no definition is known, "" where there are none such.
    """

    name: str
    agent: str
    task: str
    tells_fallbacks: bool
    waits_for_reason: bool
    undefined: str = ""
    goals: dict[str, Goal] = field(default_factory=dict)
    n_former: int = 0

    def goal(self, key: str, new: Callable[[], Goal]) -> Goal:
        """Return a goal by its key, a new one where it is new."""
        if key not in self.goals:
            self.goals[key] = new()
        return self.goals[key]

    def retire(self, key: str) -> None:
        """Let the key of a goal that has ended stand for another one."""
        self.n_former += 1
        self.goals[f"{key} {self.n_former}"] = self.goals.pop(key)

    def settled(self, goal: Goal) -> Iterator[Fact]:
        """Tell what is certain by now and was not told."""
        if not (goal.agent and goal.task):
            return
        end = goal.end if goal.end and (goal.reason is not None or not self.waits_for_reason) else None
        yield from _told(goal, end)

    def finish(self, notes: Notes) -> Iterator[Fact]:
        """Tell the rest, by what is likely where nothing is certain."""
        for goal in self.goals.values():
            if goal.rejected is not None or goal.left_out:
                continue
            end = goal.end or goal.likely_end
            if goal.started is None:
                self._assume_start(goal, end, notes)
            if goal.started is None:
                continue
            if not (goal.agent and goal.task):
                goal.agent, goal.task = goal.agent or self.agent, goal.task or self.task
                if self.tells_fallbacks:
                    called = f"they count as {goal.task!r} of {goal.agent!r}"
                    notes.remark("goal_not_recorded", f"{{}} of {self.name}: {self._why_unread()}; {called}")
            elif self.undefined and not self.tells_fallbacks:
                notes.remark("goals_unread", f"{{}} of {self.name}: {self._why_unread()}; all are {goal.task!r}")
            yield from _told(goal, end)

    def _why_unread(self) -> str:
        if not self.undefined:
            return "their goals are not in the recording"
        return (
            f"their goals are in the recording, but not the definition of {self.undefined}; give it in the mapping, "
            'such as definition = "string task" for a goal of one text'
        )

    def _assume_start(self, goal: Goal, end: End | None, notes: Notes) -> None:
        """Set the start of a goal that was never seen to run."""
        if goal.likely_start is not None:
            goal.started = goal.likely_start
            return
        if end is None:
            return
        goal.started = goal.accepted or end.at
        since = "their acceptance" if goal.accepted else "their end, without a length"
        notes.remark("start_assumed", f"{{}} of {self.name}: seen only when they had ended; they count from {since}")

    def leave_out(self, goal: Goal, notes: Notes) -> None:
        """Forget a goal that had ended when the recording began: nobody knows when."""
        goal.left_out = True
        when = "they had ended when the recording began, at a time that is not known, and were left out"
        notes.remark("ended_before", f"{{}} of {self.name}: {when}")


def _told(goal: Goal, end: End | None) -> Iterator[Fact]:
    """Return the facts of a goal that were not told before, in their order."""
    facts: list[Fact] = []
    started = goal.started
    if started is None:
        return
    task = TaskStarted(time_ns=started.ns, agent=goal.agent, task=goal.task, execution_id=goal.execution_id)
    if goal.accepted is not None and goal.accepted != started and goal.accepted.clock is started.clock:
        facts.append(Fact(event_on(TaskDispatched, task, time_ns=goal.accepted.ns), goal.accepted.clock))
    facts.append(Fact(task, started.clock))
    if end is not None:
        reason = end.reason or goal.reason or ""
        ended = event_on(TaskEnded, task, time_ns=end.at.ns, outcome=end.outcome, reason=reason)
        facts.append(Fact(ended, end.at.clock))
    yield from facts[goal.n_told :]
    goal.n_told = len(facts)


def goals_of(name: str, agent: Value, task: Value, *, waits_for_reason: bool) -> Goals:
    """Return the goals of an action, none so far.

    Args:
        name: of the action, `/agent/task` as far as names stand for what is not recorded.
        agent: who carries it out.
        task: what it is called.
        waits_for_reason: whether the end is told only when the result is there.
    """
    first, *_, last = f"{name.strip('/')}/{name.strip('/')}".split("/")
    is_told = (agent.path is not None and not agent.default) or (task.path is not None and not task.default)
    return Goals(name, agent.default or first, task.default or last, is_told, waits_for_reason)


def rejection(goal: Goal, at: Instant, reason: str) -> Fact:
    """Return the refusal of a goal, which then has no execution."""
    goal.rejected = CommandRejected(
        time_ns=at.ns, command_id=goal.execution_id, agent=goal.agent, task=goal.task, reason=reason
    )
    return Fact(goal.rejected, at.clock)


OUTCOMES_ROS2: Final = {4: Outcome.SUCCEEDED, 5: Outcome.CANCELED, 6: Outcome.FAILED}
"""Terminal states of a ROS 2 goal."""

OUTCOMES_ROS1: Final = {2: Outcome.CANCELED, 3: Outcome.SUCCEEDED, 4: Outcome.FAILED, 9: Outcome.FAILED}
"""Terminal states of a ROS 1 goal that ran."""
