"""Plan the rest of a run that goes on: after a failure, or when it is late.

What is over or under way stays as it is. An agent that has begun a chain of tasks goes on with it. Everything else,
including failed work, is planned anew. A chain that an agent left for other work starts again from its first task.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from hrclog.analyzers.search.evaluate import Begun
from hrclog.analyzers.search.exhaustive import judge_all
from hrclog.analyzers.search.forecast import Forecast, forecast, with_expected_times
from hrclog.analyzers.search.judge import Judge, Objective, possible_plan
from hrclog.analyzers.search.kept_items import with_ids
from hrclog.analyzers.search.local_search import Effort, local_search
from hrclog.analyzers.search.outcome import Ranked
from hrclog.analyzers.search.space import Candidate, Space, space_of
from hrclog.analyzers.search.worlds import Worlds, drawn_worlds
from hrclog.arrays import FloatArray
from hrclog.errors import ScenarioError
from hrclog.events import Outcome
from hrclog.knowledge.task_times import TaskTimes
from hrclog.planning.plan import Plan, PlanItem
from hrclog.planning.problem import PrecedenceKind, Problem
from hrclog.planning.run_state import Replan, RunState

LEAST_GAIN_S: Final = 0.5
"""A late run keeps its plan unless another one is expected to save more than this."""

_WORLDS: Final = 32
_MOST_ENUMERATED: Final = 400
_EFFORT: Final = Effort(plans=600)
_WORLDS_TOLD: Final = 100
_LEAST_SIGMA: Final = 1e-9  # of log work that does not vary


@dataclass(frozen=True, slots=True)
class Rest:
    """What is left of a run.

    Attributes:
        space: the plans that it can go on with, what is over and under way included.
        begun: where it stands; `left_s` has an entry per world.
        fixed: of each agent the items that are over, then the one under way.
    """

    space: Space
    begun: Begun
    fixed: Mapping[str, tuple[PlanItem, ...]]


def replanner(problem: Problem, times: TaskTimes, objective: Objective = Objective.MEAN, seed: int = 0) -> Replan:
    """Return a function that plans the rest of runs.

    Args:
        problem: what the runs are to do.
        times: what is known.
        objective: of the makespan.
        seed: of the draws.
    """
    import scipy.special  # noqa: F401 - loaded before the run goes on, as it takes longer than a plan

    def replan(state: RunState, _reason: str) -> Plan | None:
        result = plan_rest(problem, times, state, objective, seed)
        return result[0] if result else None

    return replan


def plan_rest(
    problem: Problem, times: TaskTimes, state: RunState, objective: Objective = Objective.MEAN, seed: int = 0
) -> tuple[Plan, Forecast] | None:
    """Return the best plan found for the rest of a run, and its forecast; None to go on as before.

    Args:
        problem: what the run is to do.
        times: what is known.
        state: how the run stands.
        objective: of the makespan.
        seed: of the draws.

    Raises:
        ScenarioError: nothing is known of a task, no plan for the rest is possible, or the objective is of whole plans.
    """
    if objective is Objective.CLOSED_FORM:
        raise ScenarioError("objective closed-form: it judges whole plans, not the rest of a run; choose mean or p95")
    rest = rest_of(problem, times, state, seed)
    worlds = _draw_worlds(rest.space, times, _WORLDS, seed)
    judge = Judge(rest.space, worlds, objective, rest.begun)
    current = _current_candidate(rest, state)
    starts = [current] if current is not None else []
    enumerable = rest.space.size(_MOST_ENUMERATED) <= _MOST_ENUMERATED
    result = judge_all(judge) if enumerable else local_search(judge, _EFFORT, seed, starts=starts)
    if not result.best:
        raise ScenarioError("no plan for the rest of the run is possible: agents would wait for each other")
    best = result.best[0]
    if current is not None and not _is_better(best, float(judge.scores([current])[0])):
        return None
    plan = possible_plan(rest.space, best.candidate, state.plan.name)
    assert plan is not None  # noqa: S101 - what is impossible is not among the best
    renamed = with_ids(plan, rest.fixed, state)
    begun = replace(rest.begun, left_s=_draw_work_left(problem, times, state, rest.fixed, _WORLDS_TOLD, seed))
    rest_forecast = forecast(problem, renamed, times, worlds=_WORLDS_TOLD, seed=seed, begun=begun)
    return _with_times(renamed, rest_forecast, state), rest_forecast


def rest_of(problem: Problem, times: TaskTimes, state: RunState, seed: int = 0) -> Rest:
    """Return what is left of a run."""
    fixed = {agent: tuple(_drop_broken_chains(problem, _fixed_items(agent, state))) for agent in problem.agents}
    whole = space_of(problem)
    begun = {
        agent: (*(item.task for item in items), *_tasks_to_follow(problem, items)) for agent, items in fixed.items()
    }
    counts = _count_units_left(whole, begun)
    units = [unit for unit, count in zip(whole.units, counts, strict=True) if count]
    space = Space(problem, tuple(units), tuple(count for count in counts if count), begun)
    started = {agent: state.now_s - run.since_s for agent, run in state.running.items() if run.since_s is not None}
    over = {agent: sum(item.item_id in state.outcomes for item in items) for agent, items in fixed.items()}
    left = _draw_work_left(problem, times, state, fixed, _WORLDS, seed)
    return Rest(space, Begun(state.now_s, 0.0, over, started, left), fixed)


def _fixed_items(agent: str, state: RunState) -> Iterator[PlanItem]:
    """Yield the items that succeeded, then the one under way."""
    queue = state.plan.queue(agent)
    yield from (item for item in queue if state.outcomes.get(item.item_id) == Outcome.SUCCEEDED)
    if agent in state.running:
        yield from (item for item in queue if item.item_id == state.running[agent].item_id)


def _drop_broken_chains(problem: Problem, items: Iterable[PlanItem]) -> Iterator[PlanItem]:
    """Yield the items, except those of chains that the agent left unfinished; the last chain may still go on."""
    follower = _followers(problem)
    chain: list[PlanItem] = []
    for item in items:
        if chain and item.task != follower[chain[-1].task]:
            chain = []
        chain.append(item)
        if item.task not in follower:
            yield from chain
            chain = []
    yield from chain


def _followers(problem: Problem) -> dict[str, str]:
    return {p.before: p.after for p in problem.precedences if p.kind is PrecedenceKind.NEXT}


def _tasks_to_follow(problem: Problem, items: tuple[PlanItem, ...]) -> Iterator[str]:
    """Yield the tasks that must directly follow the last of an agent's items."""
    follower = _followers(problem)
    task = items[-1].task if items else ""
    while task in follower:
        task = follower[task]
        yield task


def _count_units_left(space: Space, begun: Mapping[str, tuple[str, ...]]) -> list[int]:
    """Return how often each unit is still to be begun; what only few agents may do is taken to be done first."""
    counts = list(space.counts)
    heads = {agent: Counter(tasks) for agent, tasks in begun.items()}
    for number in sorted(range(len(counts)), key=lambda unit: len(space.units[unit].agents)):
        unit = space.units[number]
        for agent in unit.agents:
            n_begun = min(heads[agent][unit.tasks[0]], counts[number])
            heads[agent][unit.tasks[0]] -= n_begun
            counts[number] -= n_begun
    return counts


def _draw_worlds(space: Space, times: TaskTimes, count: int, seed: int) -> Worlds:
    return drawn_worlds(times, space.keys, space.agents, space.longest(), count, seed)


def _draw_work_left(
    problem: Problem,
    times: TaskTimes,
    state: RunState,
    fixed: Mapping[str, tuple[PlanItem, ...]],
    count: int,
    seed: int,
) -> dict[str, FloatArray]:
    """Return what is left of the work under way in each world, given that it is not done yet; (S,) by agent."""
    from scipy.special import ndtr, ndtri

    running = {agent: (items[-1].task, state.running[agent].since_s) for agent, items in fixed.items()
               if agent in state.running and items}  # fmt: skip
    left: dict[str, FloatArray] = {}
    for number, agent in enumerate(problem.agents):
        task, since_s = running.get(agent, ("", None))
        if since_s is None:
            continue
        if (agent, task) not in times.times:
            question = f"how long does it take: {task} by {agent}?"
            raise ScenarioError(f"{question} No run shows it succeed, and no guess is declared")
        time = times.times[agent, task]
        work_done = max(_work_done(times, (agent, task), since_s, running), 1e-9)
        sigma = max(time.sigma, _LEAST_SIGMA)
        beyond = float(ndtr((np.log(work_done) - time.mu) / sigma))
        levels = beyond + (1 - beyond) * np.random.default_rng([seed % 2**64, number]).random(count)
        work = np.exp(time.mu + sigma * ndtri(levels.clip(0.0, 1 - 1e-12)))
        left[agent] = (work - work_done).clip(0.01)
    return left


def _work_done(
    times: TaskTimes, key: tuple[str, str], since_s: float, running: Mapping[str, tuple[str, float | None]]
) -> float:
    """Return how much work was done; it ignores other agents' tasks that ended before now."""
    factors = {(f.other_agent, f.other_task): f.log_s for f in times.times[key].factors}
    cuts = sorted(
        (min(other_since, since_s), factors.get((agent, task), 0.0))
        for agent, (task, other_since) in running.items()
        if agent != key[0] and other_since is not None
    )
    work_done, reached_s, log_s = 0.0, 0.0, sum(factor for _, factor in cuts)
    for before_s, factor in cuts:
        work_done += (before_s - reached_s) * float(np.exp(-log_s))
        reached_s, log_s = before_s, log_s - factor
    return work_done + since_s - reached_s


def _current_candidate(rest: Rest, state: RunState) -> Candidate | None:
    """Return the plan that is followed now as a candidate; None if it does not do all that is left."""
    left = {item.item_id for item in state.left()}
    orders = {}
    for agent in rest.space.agents:
        fixed = {item.item_id for item in rest.fixed[agent]}
        tasks = [i.task for i in state.plan.queue(agent) if i.item_id in left and i.item_id not in fixed]
        chain = rest.space.begun[agent][len(rest.fixed[agent]) :]
        if tuple(tasks[: len(chain)]) != chain:
            return None
        orders[agent] = tuple(tasks[len(chain) :])
    candidate = rest.space.candidate(orders)
    counts = Counter(unit for row in candidate for unit in row)
    same = all(counts[unit] == count for unit, count in enumerate(rest.space.counts))
    return candidate if same else None


def _is_better(best: Ranked, current_score: float) -> bool:
    return best.score < current_score - LEAST_GAIN_S


def _with_times(plan: Plan, rest_forecast: Forecast, state: RunState) -> Plan:
    """Return the plan with expected times; what is over keeps the times that it had."""
    old_times = {item.item_id: (item.planned_start_s, item.planned_end_s) for item in state.plan.items}
    items = []
    for item in with_expected_times(plan, rest_forecast).items:
        if item.item_id in state.outcomes:
            start, end = old_times[item.item_id]
            items.append(replace(item, planned_start_s=start, planned_end_s=end))
        else:
            items.append(item)
    return replace(plan, items=tuple(items))
