"""Search plans with a constraint solver (OR-Tools CP-SAT), which also proves how good the best can be."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

from hrclog.analyzers.search.bound import lower_bound_s
from hrclog.analyzers.search.cpsat_items import TICKS_PER_S, orders_of
from hrclog.analyzers.search.cpsat_model import ROUNDING, Model
from hrclog.analyzers.search.encoded import encode_plans
from hrclog.analyzers.search.evaluate import evaluate
from hrclog.analyzers.search.judge import Judge, possible_plan
from hrclog.analyzers.search.local_search import Effort, local_search
from hrclog.analyzers.search.outcome import Ranked, Search
from hrclog.analyzers.search.space import Candidate, Space
from hrclog.analyzers.search.worlds import Worlds
from hrclog.arrays import FloatArray
from hrclog.errors import ScenarioError

MOST_UNITS: Final = 120
"""Largest number of units of work in a model; with more, building it takes too long."""

_WARM_UP: Final = 2000
"""Number of plans that a local search judges first, so that the solver starts from a good plan."""

_LARGE: Final = 3000
"""With more variables than this, the solver does not probe the model before the search."""

_CLOSE_S: Final = 0.01
"""Gap that a proof may leave open because of rounding."""


@dataclass(frozen=True, slots=True)
class CpSat:
    """What the solver found and proved, in the expected world.

    Attributes:
        search: the starts and the solver's plans, with the scores that the evaluator gives them.
        objective_s: makespan of the solver's best plan by its own account, infinite if it has none.
        bound_s: no plan has a makespan below.
        optimal: whether the best plan was proved to be one of the best, to a hundredth of a second.
    """

    search: Search
    objective_s: float
    bound_s: float
    optimal: bool


def cpsat(space: Space, world: Worlds, seconds: float, seed: int = 0, starts: Iterable[Candidate] = ()) -> CpSat:
    """Return the best plans that the solver found, and a lower bound of the makespan.

    A search that runs to its end is reproducible; one that the time limit stops is not. With more than two agents the
    rates multiply, which the solver cannot express: it then minimises a lower bound of the makespan.

    Args:
        space: the plans.
        world: the expected world.
        seconds: how long to search.
        seed: of the search.
        starts: plans to begin with.

    Raises:
        ScenarioError: OR-Tools is missing, the space goes on from a run that has begun, or tasks have due times.
    """
    _check_supported(space, world)
    judge = Judge(space, world)
    least_s = lower_bound_s(space, world)
    warm_up = local_search(judge, Effort(_WARM_UP, seconds), seed, starts=starts)
    if not warm_up.best:
        return CpSat(warm_up, math.inf, least_s, optimal=False)
    best = warm_up.best[0]
    model = Model(space, world, best.score, least_s * (1 - 1e-9))
    model.hint(best.candidate, *_given_and_end_s(space, world, best.candidate))
    solution = _solve(model, len(space.agents), seconds, seed)
    scores = map(Ranked, judge.scores(solution.plans).tolist(), solution.plans)
    plans = sorted({*warm_up.best, *(ranked for ranked in scores if ranked.score < math.inf)})
    bound_s = max((solution.bound - ROUNDING) / TICKS_PER_S, least_s)
    stopped = "" if solution.finished else f"after {seconds:g} s"
    search = Search(tuple(plans), warm_up.judged + len(solution.plans), exhaustive=False, stopped=stopped)
    return CpSat(search, solution.objective / TICKS_PER_S, bound_s, plans[0].score - bound_s <= _CLOSE_S)


def _check_supported(space: Space, world: Worlds) -> None:
    try:
        import ortools  # noqa: F401 - only whether it is there
    except ImportError as error:
        raise ScenarioError(
            "planner cpsat: OR-Tools is missing; pip install 'hrclog[plan]', or choose local search"
        ) from error
    due = [task.name for task in space.problem.tasks if task.due_s is not None]
    if due:
        raise ScenarioError(f"planner cpsat: task {due[0]!r} has a due time, not supported; choose local search")
    if space.begun:
        raise ScenarioError("planner cpsat: cannot go on with a run that has begun; choose local search")
    if sum(space.counts) > MOST_UNITS:
        complaint = f"found {sum(space.counts)} pieces of work, expected at most {MOST_UNITS}"
        raise ScenarioError(f"planner cpsat: {complaint}; choose local search")
    if world.count != 1:
        raise ScenarioError(f"planner cpsat: found {world.count} worlds, expected the expected world; choose the mean")


def _given_and_end_s(space: Space, world: Worlds, candidate: Candidate) -> tuple[FloatArray, FloatArray]:
    """Return when items are given and when they end, shape (A, P) each."""
    plan = possible_plan(space, candidate)
    assert plan is not None  # noqa: S101 - it was judged possible
    evaluated = evaluate(encode_plans(space.problem, space.keys, [plan]), world, timeline=True)
    assert evaluated.start_s is not None  # noqa: S101 - timelines were asked for
    assert evaluated.end_s is not None  # noqa: S101 - timelines were asked for
    return evaluated.start_s[0, 0] - world.gap_s[0, :, :1], evaluated.end_s[0, 0]


@dataclass(frozen=True, slots=True)
class _Solution:
    """The solver's result, in ticks."""

    plans: list[Candidate]
    objective: float
    bound: float
    finished: bool


def _solve(model: Model, agents: int, seconds: float, seed: int) -> _Solution:
    from ortools.sat.python import cp_model

    candidates: dict[Candidate, None] = {}

    class _Collector(cp_model.CpSolverSolutionCallback):
        def on_solution_callback(self) -> None:
            chains = [chain for chain in model.items.chains if self.boolean_value(chain.taken)]
            candidates[orders_of([(chain, self.value(chain.first.given)) for chain in chains], agents)] = None

    _complete_hint(model)
    solver = cp_model.CpSolver()
    solver.parameters.random_seed = seed % 2**31
    solver.parameters.catch_sigint_signal = False  # who presses Ctrl-C wants no plan
    solver.parameters.num_workers = 1  # with more, the answer depends on who is first
    solver.parameters.linearization_level = 2  # without the linear relaxation the bound hardly moves
    if len(model.cp.proto.variables) > _LARGE:
        solver.parameters.cp_model_probing_level = 0  # probing every variable would take all the time
    solver.parameters.absolute_gap_limit = _CLOSE_S / 2 * TICKS_PER_S
    solver.parameters.max_time_in_seconds = seconds
    status = solver.solve(model.cp, _Collector())
    objective = solver.objective_value if candidates else math.inf
    return _Solution(list(candidates), objective, solver.best_objective_bound, status == cp_model.OPTIMAL)


def _complete_hint(model: Model) -> None:
    """Propose a value for every variable: otherwise the solver may ignore the proposed plan in a large problem."""
    from ortools.sat.python import cp_model

    cp: Any = model.cp
    solver = cp_model.CpSolver()
    solver.parameters.num_workers = 1
    solver.parameters.fix_variables_to_their_hinted_value = True
    if solver.solve(cp) in {cp_model.OPTIMAL, cp_model.FEASIBLE}:
        variables = [cp.get_int_var_from_proto_index(number) for number in range(len(cp.proto.variables))]
        cp.clear_hints()
        for variable in variables:
            cp.add_hint(variable, solver.value(variable))
