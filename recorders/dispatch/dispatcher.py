"""Carry out a plan: dispatch items, retry them, give them up, and ask for other plans."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from functools import partial

from hrclog.errors import HrclogError, LogWriteError
from hrclog.events import AnnotationAdded, Event, Outcome, PlanChanged, Role, TaskEnded
from hrclog.ids import new_id as new_uuid
from hrclog.planning.dispatch_mode import MODES, DispatchMode, Schedule, schedule_of
from hrclog.planning.dispatch_rule import Decision, Verdict, decide
from hrclog.planning.plan import Plan, PlanItem
from hrclog.recorders.clock import Action, Clock
from hrclog.recorders.dispatch.policy import OnFailure, ReplanOn
from hrclog.recorders.dispatch.replanning import Replanner
from hrclog.recorders.dispatch.run_setup import RunSetup
from hrclog.recorders.dispatch.task_manager import AFTER_ALL, TaskManager
from hrclog.recorders.executors.protocol import Command, Emit, Executor
from hrclog.units import NS_PER_S

_FAILURES = (Outcome.FAILED, Outcome.TIMED_OUT)


class Dispatcher:
    """Give every agent its next item as soon as the dispatch rule allows it.

    Everything happens on the clock's thread; `arrive` and `abort` may be called from any.

    Args:
        setup: plan, problem, policy, and who is asked for another plan.
        executors: by agent; they are connected here.
        clock: simulated or real; the plan's seconds count from where it stands now.
        run_id: the run.
        emit: takes every event, those of the executors too; it numbers them.
        new_id: makes command and execution ids.
        on_done: called once, when nothing is left to do.

    Raises:
        ScenarioError: in this mode the plan's items wait for each other in a circle.
    """

    def __init__(
        self,
        setup: RunSetup,
        executors: Mapping[str, Executor],
        clock: Clock,
        *,
        run_id: str,
        emit: Emit,
        new_id: Callable[[], str] = new_uuid,
        on_done: Action = lambda: None,
    ) -> None:
        plan, problem, policy = setup.plan, setup.problem, setup.policy
        self.outcomes: dict[str, str] = {}
        """Final outcome of every item that is over, also of those that only a former plan had."""
        self.stuck: tuple[PlanItem, ...] = ()
        """The items that were left when running executions could not go on, or none."""
        self.done = False
        """Whether nothing is left to do."""
        self._schedule = schedule_of(plan, DispatchMode(policy.mode), problem)
        self._plan = plan
        self._problem = problem
        self._tasks = {task.name: task for task in problem.tasks}
        self._clock = clock
        self._policy = policy
        self._run_id = run_id
        self._emit = emit
        self._new_id = new_id
        self._on_done = on_done
        self._start_ns = clock.now_ns
        self._items = {item.item_id: item for item in plan.items}
        self._open_items = set(self._items)  # those that are not over
        self._items_under_way: dict[str, str] = {}  # item by agent: dispatched, running or about to be tried again
        self._facts: set[str] = set()
        self._abort_verdict: tuple[str, str] | None = None  # outcome and reason of an aborted run
        self._retrying_agents: set[str] = set()
        self._timers: set[object] = set()
        self._steps: deque[Action] = deque()
        self._n_steps = 0
        self._stepping = False
        self._n_requests = 0  # requests for another plan that wait for their turn; until then nothing new begins
        self._replanner = Replanner(setup.replan, plan, problem, policy, clock, self._request_replan)
        self._manager = TaskManager(problem, executors, clock, policy, self._emit_event, self._handle_end)

    def run(self) -> None:
        """Carry the plan out to its end."""
        for arrival in self._plan.arrivals:
            self._schedule_step(self._instant_ns(arrival.at_s), partial(self._handle_fact, arrival.fact))
        self._clock.submit(partial(self._do_step, self._dispatch_all))  # after what executors have said so far
        try:
            while not self.done:
                self._clock.run(lambda: self.done)
                if not self.done:
                    self._do_step(self._handle_standstill)
        finally:
            self._manager.close()

    def arrive(self, fact: str) -> None:
        """Note that a fact holds from now on, for items that need it."""
        self._clock.submit(partial(self._do_step, partial(self._handle_fact, fact)))

    def abort(self, reason: str, outcome: str = Outcome.CANCELED) -> None:
        """Cancel what runs and end the run; what has not begun is left out of the log."""
        self._clock.submit(partial(self._do_step, partial(self._abort, reason, outcome)))

    def verdict(self) -> tuple[str, str]:
        """Return the outcome of the run and why; a failure names executors that do not answer."""
        outcome, reason = self._outcome()
        hung = () if outcome == Outcome.CANCELED else self._manager.lost.values()
        return outcome, "; ".join(filter(None, (reason, *hung)))

    def _outcome(self) -> tuple[str, str]:
        if self._abort_verdict is not None:
            return self._abort_verdict
        final_outcomes = [self.outcomes[item_id] for item_id in self._items if item_id in self.outcomes]
        n_lost = sum(outcome != Outcome.SUCCEEDED for outcome in final_outcomes)
        if n_lost:
            return Outcome.FAILED, f"{n_lost} of {len(final_outcomes)} items did not succeed"
        missing_work = self._replanner.left_out(self.outcomes)
        if missing_work and self.done:
            return Outcome.FAILED, f"not all of the first plan was done: {missing_work}"
        return Outcome.SUCCEEDED, ""

    def _emit_event(self, event: Event) -> None:
        self._emit(event)
        self._replanner.take(event)

    def _do_step(self, action: Action) -> None:
        """Run actions one after the other: immediate answers of executors wait for their turn."""
        self._steps.append(action)
        self._n_steps += 1
        if self._stepping:
            return
        self._stepping = True
        try:
            while self._steps:
                self._steps.popleft()()
        finally:
            self._stepping = False
        self._check_end()

    def _check_end(self) -> None:
        if self.done or self._manager.active:
            return
        if self._abort_verdict is not None or not self._open_items:
            self.done = True
            self._on_done()
        elif not self._timers and self._policy.max_wait_s is not None:
            wait_ns = round(self._policy.max_wait_s * NS_PER_S)
            self._clock.schedule(self._clock.now_ns + wait_ns, partial(self._stop_waiting, self._n_steps), AFTER_ALL)

    def _stop_waiting(self, n_steps: int) -> None:
        if n_steps == self._n_steps and not self.done:
            self._do_step(self._handle_standstill)

    def _dispatch_all(self) -> None:
        """Dispatch for every agent until nothing changes: a skipped item may allow or exclude items of others."""
        while self._abort_verdict is None:
            skipped = [agent for agent in self._schedule.queues if self._dispatch(agent)]
            if not skipped:
                return

    def _dispatch(self, agent: str) -> bool:
        """Apply the dispatch rule to an agent, and return whether an item was skipped."""
        if self._n_requests:
            return False
        decision = self._decide(agent)
        if decision.item is None:
            return False
        if agent in self._manager.lost:
            self._skip(decision.item, self._manager.lost[agent])
            return True
        if decision.verdict is Verdict.SKIP:
            lost = ", ".join(f"{other} ({self.outcomes[other]})" for other in decision.because)
            self._skip(decision.item, f"needs {lost}")
            return True
        if decision.verdict is Verdict.START:
            self._send_command(decision.item, 1)
        elif decision.not_before_s is not None:
            wake_ns = self._start_ns + math.ceil(decision.not_before_s * NS_PER_S)
            self._schedule_step(max(wake_ns, self._clock.now_ns + 1), partial(self._wake, agent))
        return False

    def _decide(self, agent: str) -> Decision:
        timed = MODES[self._policy.mode].timed
        return decide(
            self._schedule.queues[agent],
            self.outcomes,
            busy=agent in self._items_under_way,
            now_s=(self._clock.now_ns - self._start_ns) / NS_PER_S if timed else None,
            facts=self._facts,
            rules=self._schedule.rules,
            under_way=self._items_under_way.values(),
        )

    def _wake(self, agent: str) -> None:
        if self._abort_verdict is None and self._dispatch(agent):
            self._dispatch_all()

    def _schedule_step(self, time_ns: int, action: Action) -> None:
        """Run a step at an instant if the plan is still the same. The dispatcher waits for it until then."""
        timer = object()

        def due() -> None:
            if timer in self._timers:
                self._timers.discard(timer)
                self._do_step(action)

        self._timers.add(timer)
        self._clock.schedule(time_ns, due)

    def _send_command(self, item: PlanItem, attempt: int) -> None:
        task = self._tasks.get(item.task)
        command = Command(
            run_id=self._run_id,
            command_id=self._new_id(),
            execution_id=self._new_id(),
            item_id=item.item_id,
            agent=item.agent,
            task=item.task,
            task_type=task.task_type if task else "",
            role=task.role if task else Role.PRIMARY,
            attempt=attempt,
            planned_start_ns=self._planned_ns(item.planned_start_s),
            planned_end_ns=self._planned_ns(item.planned_end_s),
        )
        self._items_under_way[item.agent] = item.item_id
        self._manager.give(command, item.timeout_s)

    def _handle_end(self, command: Command, event: TaskEnded, may_retry: bool) -> None:  # noqa: FBT001 - the form of OnEnd
        """Retry an item, or note that it is over and continue."""
        failed = event.outcome in _FAILURES and self._abort_verdict is None
        if failed and may_retry and command.attempt < self._policy.max_attempts:
            self._retrying_agents.add(command.agent)
            self._do_step(partial(self._retry, command, event.outcome))
            return
        self._mark_over(command.item_id, event.outcome, command.agent)
        next_action: Action = self._dispatch_all
        if failed and self._policy.on_failure == OnFailure.ABORT:
            reason = f"{command.item_id} ({command.task}) failed {command.attempt} times"
            next_action = partial(self._abort, reason, Outcome.FAILED)
        if failed and self._replanner.wants(ReplanOn.FAILURE):
            detail = f": {event.reason}" if event.reason else ""
            self._request_replan(
                command.item_id, f"{command.item_id} ({command.task}) {event.outcome}{detail}", next_action
            )
        else:
            self._do_step(next_action)

    def _mark_over(self, item_id: str, outcome: str, agent: str = "") -> None:
        """Note how an item ended, and that its agent is free."""
        self.outcomes[item_id] = outcome
        self._open_items.discard(item_id)
        self._items_under_way.pop(agent, None)

    def _retry(self, command: Command, outcome: str) -> None:
        """Begin the next attempt, unless the run was aborted in the meantime."""
        self._retrying_agents.discard(command.agent)
        if self._abort_verdict is None:
            self._send_command(self._items[command.item_id], command.attempt + 1)
        else:
            self._mark_over(command.item_id, outcome, command.agent)

    def _abort(self, reason: str, outcome: str) -> None:
        if self._abort_verdict is not None or self.done:
            return
        self._abort_verdict = (outcome, reason)
        for execution_id in list(self._manager.active.values()):
            self._manager.cancel(execution_id, reason)

    def _handle_fact(self, fact: str) -> None:
        self._add_fact(fact)
        self._dispatch_all()

    def _add_fact(self, fact: str) -> None:
        if fact not in self._facts and not self.done:
            self._facts.add(fact)
            self._annotate(f"{fact} arrived", {"arrived": fact})

    def _annotate(self, text: str, details: dict[str, str] | None = None) -> None:
        safe_text = text.encode(errors="backslashreplace").decode()  # what every log can hold
        self._emit_event(
            AnnotationAdded(time_ns=self._clock.now_ns, run_id=self._run_id, reason=safe_text, details=details or {})
        )

    def _request_replan(self, item_id: str, reason: str, fallback: Action | None = None) -> None:
        """Ask for another plan when this step has its turn. Without another plan run the fallback, usually continue."""
        if not self.done:
            self._n_requests += 1
            self._do_step(partial(self._replan, item_id, reason, fallback or self._dispatch_all))

    def _replan(self, item_id: str, reason: str, fallback: Action) -> None:
        if self._retrying_agents:  # wait for their next attempts, which decide what is running
            self._steps.append(partial(self._replan, item_id, reason, fallback))
            return
        self._n_requests -= 1
        replaced = item_id not in self._items  # by a plan that was asked for on something else at this instant
        if self._abort_verdict is not None or replaced or self._change_plan(reason):
            self._dispatch_all()
        else:
            fallback()

    def _change_plan(self, reason: str) -> bool:
        """Follow another plan if there is one, and return whether there is."""
        try:
            plan = self._replanner.ask(reason)
            if plan is None:
                return False
            schedule = schedule_of(plan, DispatchMode(self._policy.mode), self._problem)
            now_ns = self._clock.now_ns
            self._emit_event(PlanChanged(time_ns=now_ns, run_id=self._run_id, plan=plan.to_json(), reason=reason))
        except LogWriteError:
            raise
        except Exception as error:  # noqa: BLE001 - a planner is foreign code: the cell goes on without it
            problem = str(error) if isinstance(error, HrclogError) else f"{type(error).__name__}: {error}"
            self._annotate(f"asked for another plan ({reason}), going on as before: {problem}")
            return False
        self._follow(plan, schedule)
        return True

    def _follow(self, plan: Plan, schedule: Schedule) -> None:
        """Replace the current plan. Items that the new plan leaves out and that had not begun are dropped."""
        self._plan, self._schedule = plan, schedule
        self._items = {item.item_id: item for item in plan.items}
        self._open_items = self._items.keys() - self.outcomes.keys()
        self._timers.clear()
        self._replanner.follow(plan)
        for arrival in plan.arrivals:
            if self._instant_ns(arrival.at_s) <= self._clock.now_ns:
                self._add_fact(arrival.fact)
            else:
                self._schedule_step(self._instant_ns(arrival.at_s), partial(self._handle_fact, arrival.fact))

    def _handle_standstill(self) -> None:
        """Give up the remaining items when nothing more can happen."""
        open_items = [item for item in self._plan.items if item.item_id not in self.outcomes]
        if self._manager.active:
            self.stuck = self.stuck or tuple(open_items)
            for execution_id in list(self._manager.active.values()):
                self._manager.cancel(execution_id, "standstill: nothing more was going to happen")
            return
        reasons = {item.item_id: self._skip_reason(item, open_items) for item in open_items}
        for item in open_items:
            self._skip(item, reasons[item.item_id])

    def _skip_reason(self, item: PlanItem, open_items: Iterable[PlanItem]) -> str:
        missing = [fact for fact in item.needs if fact not in self._facts]
        if missing:
            return f"needs {', '.join(missing)}, which never arrived"
        decision = self._decide(item.agent)
        names = decision.because or ((decision.item.item_id,) if decision.item and decision.item is not item else ())
        blockers = ", ".join(names) or ", ".join(other.item_id for other in open_items if other is not item)
        return f"the plan cannot go on: it waits for {blockers}" if blockers else "the plan cannot go on"

    def _skip(self, item: PlanItem, reason: str) -> None:
        task = self._tasks.get(item.task)
        self._mark_over(item.item_id, Outcome.SKIPPED)
        self._emit_event(
            TaskEnded(
                time_ns=self._clock.now_ns,
                run_id=self._run_id,
                agent=item.agent,
                task=item.task,
                execution_id=self._new_id(),
                task_type=task.task_type if task else "",
                role=task.role if task else Role.PRIMARY,
                item_id=item.item_id,
                outcome=Outcome.SKIPPED,
                reason=reason,
            )
        )

    def _instant_ns(self, second: float) -> int:
        return self._start_ns + round(second * NS_PER_S)

    def _planned_ns(self, planned_s: float | None) -> int | None:
        return None if planned_s is None else self._instant_ns(planned_s)
