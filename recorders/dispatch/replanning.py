"""Replan a run under way: when to ask for another plan, whether it can be followed, and what it leaves out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import partial

from hrclog.errors import DispatchError
from hrclog.events import Event, Outcome, TaskDispatched, TaskFact, TaskStarted
from hrclog.planning.plan import Plan, PlanItem, plan_of_value
from hrclog.planning.problem import Problem
from hrclog.planning.run_state import Fold, Replan, RunState
from hrclog.recorders.clock import Clock
from hrclog.recorders.dispatch.policy import DispatchPolicy, ReplanOn
from hrclog.recorders.dispatch.task_manager import AFTER_ALL
from hrclog.units import NS_PER_S


class Replanner:
    """Ask for other plans as a policy says, and refuse those that cannot be followed.

    Args:
        replan: makes plans; None: nobody is asked.
        plan: followed from the start; it says what work there is.
        problem: the tasks there are.
        policy: when to ask, and how often.
        clock: stands at the start of the run.
        on_delay: told which item is late, and how, when all has happened that happens at that instant.
    """

    def __init__(
        self,
        replan: Replan | None,
        plan: Plan,
        problem: Problem,
        policy: DispatchPolicy,
        clock: Clock,
        on_delay: Callable[[str, str], None],
    ) -> None:
        self._replan = replan
        self._problem = problem
        self._policy = policy
        self._clock = clock
        self._on_delay = on_delay
        self._start_ns = clock.now_ns
        self._fold = Fold(plan, self._start_ns)
        self._items = {item.item_id: item for item in plan.items}  # of all plans, an id's last one
        self._n_planned = Counter(item.task for item in plan.items if not _is_extra(item.task, problem))
        self._reported_late: set[str] = set()  # items that were asked about
        self._n_changes = 0

    def take(self, event: Event) -> None:
        """Take in the next event of the run."""
        if self._replan is None:
            return
        self._fold.take(event)
        if isinstance(event, TaskFact) and not event.parent_execution_id and self.wants(ReplanOn.DELAY):
            item = self._items[event.item_id]
            if isinstance(event, TaskDispatched):
                self._schedule_delay_check(item)
            elif isinstance(event, TaskStarted) and item.planned_start_s is not None:
                late_s = self._late_s(item.planned_start_s, event.time_ns)
                self._report_delay(item, late_s, f"started {late_s:.1f} s late")

    def wants(self, cause: ReplanOn) -> bool:
        """Return whether another plan is asked for on something."""
        return self._replan is not None and cause in self._policy.replan_on

    def ask(self, reason: str) -> Plan | None:
        """Return another plan to follow, None to go on as before.

        Args:
            reason: why one is asked for.

        Raises:
            DispatchError: the plan has been changed often enough, or the new one cannot be followed from here.
            ScenarioError: it is no plan.
        """
        if self._replan is None:
            return None
        if self._n_changes >= self._policy.max_replans:
            raise DispatchError(f"the plan was changed {self._n_changes} times; max_replans allows no more, raise it")
        state = self._fold.state(self._clock.now_ns)
        plan = self._replan(state, reason)
        if plan is None or plan == state.plan:
            return None
        self._check_plan(plan, state)
        return plan

    def follow(self, plan: Plan) -> None:
        """Note that a plan is followed from now on."""
        self._n_changes += 1
        self._items |= {item.item_id: item for item in plan.items}
        if self.wants(ReplanOn.DELAY):
            for run in self._fold.state().running.values():
                self._schedule_delay_check(self._items[run.item_id])

    def left_out(self, outcomes: dict[str, str]) -> str:
        """Return which work of the first plan was not done in the end, "" if all was."""
        n_done = Counter(self._items[name].task for name, outcome in outcomes.items() if outcome == Outcome.SUCCEEDED)
        shortfalls = [f"{task} {n_done[task]} of {n} times" for task, n in self._n_planned.items() if n_done[task] < n]
        return ", ".join(shortfalls)

    def _schedule_delay_check(self, item: PlanItem) -> None:
        """Schedule a check of an item for when its end is overdue."""
        if item.planned_end_s is not None:
            late_ns = self._instant_ns(item.planned_end_s) + round(self._policy.delay_s * NS_PER_S) + 1
            self._clock.schedule(late_ns, partial(self._check_delay, item.item_id), AFTER_ALL)

    def _check_delay(self, item_id: str) -> None:
        item = self._items[item_id]
        under_way = any(run.item_id == item_id for run in self._fold.state().running.values())
        if under_way and item.planned_end_s is not None:
            late_s = self._late_s(item.planned_end_s, self._clock.now_ns)
            self._report_delay(item, late_s, f"is {late_s:.1f} s over its planned end")

    def _report_delay(self, item: PlanItem, late_s: float, text: str) -> None:
        if late_s > self._policy.delay_s and item.item_id not in self._reported_late:
            self._reported_late.add(item.item_id)
            report = partial(self._on_delay, item.item_id, f"{item.item_id} ({item.task}) {text}")
            self._clock.schedule(self._clock.now_ns, report, AFTER_ALL)

    def _late_s(self, planned_s: float, time_ns: int) -> float:
        return (time_ns - self._instant_ns(planned_s)) / NS_PER_S

    def _instant_ns(self, second: float) -> int:
        return self._start_ns + round(second * NS_PER_S)

    def _check_plan(self, plan: Plan, state: RunState) -> None:
        """Raise if a plan cannot replace the current one."""
        where = f"plan {plan.name!r}"
        plan_of_value(plan.to_json(), where)  # what could not be read from the log again
        running = {run.item_id for run in state.running.values()}
        for item in plan.items:
            if item.item_id in state.outcomes or item.item_id in running:
                _check_same_work(item, self._items[item.item_id], where)
            else:
                _check_agent(item, self._problem, where)
        for agent, run in state.running.items():
            open_items = [item.item_id for item in plan.queue(agent) if item.item_id not in state.outcomes]
            if not open_items or open_items[0] != run.item_id:
                actual = f"found {open_items[0]!r}" if open_items else "found nothing"
                remedy = f"expected {run.item_id!r}, which is running; put it first"
                raise DispatchError(f"{where}: first of what is left to {agent!r}: {actual}, {remedy}")


def _check_same_work(item: PlanItem, begun_item: PlanItem, where: str) -> None:
    if (item.agent, item.task) != (begun_item.agent, begun_item.task):
        begun_text = f"it was begun as {begun_item.task!r} by {begun_item.agent!r}"
        raise DispatchError(
            f"{where}: item {item.item_id!r} is {item.task!r} by {item.agent!r}, but {begun_text}; give it a new id"
        )


def _check_agent(item: PlanItem, problem: Problem, where: str) -> None:
    domain = problem.task(item.task).agents
    if item.agent not in domain:
        raise DispatchError(f"{where}: {item.agent!r} cannot do {item.task!r}, only {', '.join(domain)} can; move it")


def _is_extra(task: str, problem: Problem) -> bool:
    return any(known_task.name == task for known_task in problem.tasks) and problem.is_extra(task)
