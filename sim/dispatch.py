"""Carry a plan out in simulated time: dispatch, retry, skip, abort."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

from hrclog.dispatch_rule import Decision, Verdict, decide
from hrclog.errors import ScenarioError
from hrclog.events import Event, Outcome, TaskDispatched, TaskEnded
from hrclog.plan import Plan, PlanItem
from hrclog.recorders.executor import Command, Emit, Executor, event_on
from hrclog.sim.event_queue import EventQueue
from hrclog.sim.scenario import ABORT, TIMED, Scenario

NS_PER_S = 1_000_000_000


class SimulatedDispatcher:
    """Give every agent its next item as soon as the dispatch rule allows it.

    Args:
        scenario: for failures and the dispatch mode.
        plan: what to carry out; with planned times in mode `timed`.
        executor: carries out the items of all agents.
        queue: the simulated clock, which stands at the start of the run.
        run_id: the run.
        new_id: makes command and execution ids.
        next_seq: numbers the events of the run.
        emit: takes every event, the executor's too.
    """

    def __init__(
        self,
        scenario: Scenario,
        plan: Plan,
        executor: Executor,
        queue: EventQueue,
        run_id: str,
        new_id: Callable[[], str],
        next_seq: Callable[[], int],
        emit: Emit,
    ) -> None:
        self.outcomes: dict[str, str] = {}
        self.aborted = ""
        self._scenario = scenario
        self._executor = executor
        self._queue = queue
        self._run_id = run_id
        self._new_id = new_id
        self._next_seq = next_seq
        self._emit = emit
        self._start_ns = queue.now_ns
        self._queues = {agent: plan.queue(agent) for agent in plan.agents()}
        self._items = {item.item_id: item for item in plan.items}
        self._types = {task.name: task.task_type for task in scenario.problem.tasks}
        self._active: dict[str, str] = {}  # execution id by agent
        executor.connect(self._take)

    def run(self) -> None:
        """Carry the plan out to its end.

        Raises:
            ScenarioError: the agents wait for each other for ever.
        """
        self._dispatch_all()
        self._queue.run()
        left = [item_id for item_id in self._items if item_id not in self.outcomes]
        if left and not self.aborted:
            items = ", ".join(f"{item_id} ({self._items[item_id].task})" for item_id in left[:4])
            raise ScenarioError(f"{self._scenario.name}: standstill, agents stop or wait for each other at {items}")

    def _take(self, event: Event) -> None:
        self._emit(event)
        if isinstance(event, TaskEnded):
            del self._active[event.agent]
            self._close(event)

    def _close(self, event: TaskEnded) -> None:
        failed = event.outcome == Outcome.FAILED and not self.aborted
        if failed and event.attempt < self._scenario.failures.max_attempts:
            self._send(self._items[event.item_id], event.attempt + 1)
            return
        self.outcomes[event.item_id] = event.outcome
        if failed and self._scenario.failures.on_failure == ABORT:
            self._abort(event)
        self._dispatch_all()

    def _abort(self, event: TaskEnded) -> None:
        self.aborted = f"{event.item_id} ({event.task}) failed {event.attempt} times"
        for execution_id in list(self._active.values()):
            self._executor.cancel(execution_id, self.aborted)

    def _dispatch_all(self) -> None:
        """Ask for every agent until nothing changes: a skipped item may free or doom another agent's."""
        changed = not self.aborted
        while changed:
            skipped = [agent for agent in self._queues if self._dispatch(agent)]
            changed = bool(skipped)

    def _dispatch(self, agent: str) -> bool:
        """Do what the rule says for an agent, and return whether an item was skipped."""
        now_s = (self._queue.now_ns - self._start_ns) / NS_PER_S if self._scenario.dispatch_mode == TIMED else None
        decision = decide(self._queues[agent], self.outcomes, busy=agent in self._active, now_s=now_s)
        if decision.item is not None:
            if decision.verdict is Verdict.START:
                self._send(decision.item, 1)
            elif decision.verdict is Verdict.SKIP:
                self._skip(decision.item, decision)
                return True
            elif decision.not_before_s is not None:
                wake_ns = self._start_ns + math.ceil(decision.not_before_s * NS_PER_S)
                self._queue.schedule(max(wake_ns, self._queue.now_ns + 1), partial(self._wake, agent))
        return False

    def _wake(self, agent: str) -> None:
        if not self.aborted and self._dispatch(agent):
            self._dispatch_all()

    def _send(self, item: PlanItem, attempt: int) -> None:
        command = Command(
            run_id=self._run_id,
            command_id=self._new_id(),
            execution_id=self._new_id(),
            item_id=item.item_id,
            agent=item.agent,
            task=item.task,
            task_type=self._types[item.task],
            attempt=attempt,
            planned_start_ns=self._instant(item.planned_start_s),
            planned_end_ns=self._instant(item.planned_end_s),
        )
        self._active[item.agent] = command.execution_id
        self._emit(
            event_on(
                TaskDispatched,
                command,
                time_ns=self._queue.now_ns,
                seq=self._next_seq(),
                planned_start_ns=command.planned_start_ns,
                planned_end_ns=command.planned_end_ns,
            )
        )
        self._executor.start(command)

    def _skip(self, item: PlanItem, decision: Decision) -> None:
        lost = ", ".join(f"{other} ({self.outcomes[other]})" for other in decision.because)
        self.outcomes[item.item_id] = Outcome.SKIPPED
        self._emit(
            TaskEnded(
                time_ns=self._queue.now_ns,
                run_id=self._run_id,
                seq=self._next_seq(),
                agent=item.agent,
                task=item.task,
                execution_id=self._new_id(),
                task_type=self._types[item.task],
                item_id=item.item_id,
                outcome=Outcome.SKIPPED,
                reason=f"needs {lost}",
            )
        )

    def _instant(self, planned_s: float | None) -> int | None:
        return None if planned_s is None else self._start_ns + round(planned_s * NS_PER_S)
