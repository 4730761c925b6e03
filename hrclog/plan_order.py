"""Which task an order may go on with: the precedences, given what was done."""

from __future__ import annotations

from collections.abc import Sequence

from hrclog.problem import Precedence, PrecedenceKind, Problem


class Ledger:
    """What was done so far, which items still have to be followed, and so which task is ready.

    Args:
        problem: its precedences and counts are kept.
    """

    def __init__(self, problem: Problem) -> None:
        self._totals = {task.name: problem.total(task.name) for task in problem.tasks}
        self._done: dict[str, list[str]] = {task.name: [] for task in problem.tasks}
        self._rules: dict[str, list[Precedence]] = {}
        for precedence in problem.precedences:
            self._rules.setdefault(precedence.after, []).append(precedence)
        self._followers = {p.before: p.after for p in problem.precedences if p.kind is PrecedenceKind.NEXT}
        self._open: dict[str, tuple[str, str]] = {}  # agent -> (task it must do next, item that asks for it)

    def due(self, agent: str) -> str | None:
        """Return the task that an agent must do next, None if it is free to choose."""
        return self._open.get(agent, (None, ""))[0]

    def ready(self, agent: str, task: str) -> bool:
        """Return whether an agent may do a task now."""
        return not self.why_not(agent, task)

    def why_not(self, agent: str, task: str) -> str:
        """Return why an agent may not do a task now, "" if it may."""
        if self.due(agent) not in (None, task):
            return f"before {self.due(agent)!r}"
        for rule in self._rules.get(task, ()):
            if not self._kept(rule, agent):
                return f"without {rule.before!r} before it ({rule.kind})"
        return ""

    def do(self, agent: str, item_id: str, task: str) -> tuple[str, ...]:
        """Note that an agent does a task as an item, and return the items it had to wait for."""
        waits: dict[str, None] = {}
        for rule in self._rules.get(task, ()):
            waits |= dict.fromkeys(self._waits(rule, agent))
        self._done[task].append(item_id)
        self._open.pop(agent, None)
        if task in self._followers:
            self._open[agent] = (self._followers[task], item_id)
        return tuple(waits)

    def _kept(self, rule: Precedence, agent: str) -> bool:
        if rule.kind is PrecedenceKind.NEXT:
            return self.due(agent) == rule.after
        done = len(self._done[rule.before])
        if rule.kind is PrecedenceKind.EACH:
            return done > len(self._done[rule.after])
        return done == self._totals[rule.before]

    def _waits(self, rule: Precedence, agent: str) -> Sequence[str]:
        if rule.kind is PrecedenceKind.NEXT:
            return (self._open[agent][1],)
        done = self._done[rule.before]
        return done if rule.kind is PrecedenceKind.ALL else (done[len(self._done[rule.after])],)
