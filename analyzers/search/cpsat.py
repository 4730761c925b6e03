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
"""Pieces of work that a model is made of; more take too long before the search even begins."""

_WARM_UP: Final = 2000
"""Plans that a local search judges before, so that the solver knows what to beat."""

_LARGE: Final = 3000
"""Variables from which on a model is searched without being probed before."""

_CLOSE_S: Final = 0.01
"""What a proof may leave open because of rounding."""


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

    A search that comes to its end is the same every time; one that time stops is not. With more than two agents the
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
    _check(space, world)
    judge = Judge(space, world)
    least_s = lower_bound_s(space, world)
    known = local_search(judge, Effort(_WARM_UP, seconds), seed, starts=starts)
    if not known.best:
        return CpSat(known, math.inf, least_s, optimal=False)
    best = known.best[0]
    model = Model(space, world, best.score, least_s * (1 - 1e-9))
    model.hint(best.candidate, *_times(space, world, best.candidate))
    solved = _solve(model, len(space.agents), seconds, seed)
    scores = map(Ranked, judge.scores(solved.plans).tolist(), solved.plans)
    plans = sorted({*known.best, *(one for one in scores if one.score < math.inf)})
    bound_s = max((solved.bound - ROUNDING) / TICKS_PER_S, least_s)
    stopped = "" if solved.finished else f"after {seconds:g} s"
    search = Search(tuple(plans), known.judged + len(solved.plans), exhaustive=False, stopped=stopped)
    return CpSat(search, solved.objective / TICKS_PER_S, bound_s, plans[0].score - bound_s <= _CLOSE_S)


def _check(space: Space, world: Worlds) -> None:
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
        found = f"found {sum(space.counts)} pieces of work, expected at most {MOST_UNITS}"
        raise ScenarioError(f"planner cpsat: {found}; choose local search")
    if world.count != 1:
        raise ScenarioError(f"planner cpsat: found {world.count} worlds, expected the expected world; choose the mean")


def _times(space: Space, world: Worlds, candidate: Candidate) -> tuple[FloatArray, FloatArray]:
    """Return when items are given and when they end, shape (A, P) each."""
    plan = possible_plan(space, candidate)
    assert plan is not None  # noqa: S101 - it was judged possible
    found = evaluate(encode_plans(space.problem, space.keys, [plan]), world, timeline=True)
    assert found.start_s is not None  # noqa: S101 - timelines were asked for
    assert found.end_s is not None  # noqa: S101 - timelines were asked for
    return found.start_s[0, 0] - world.gap_s[0, :, :1], found.end_s[0, 0]


@dataclass(frozen=True, slots=True)
class _Solved:
    """What the solver says, in ticks."""

    plans: list[Candidate]
    objective: float
    bound: float
    finished: bool


def _solve(model: Model, agents: int, seconds: float, seed: int) -> _Solved:
    from ortools.sat.python import cp_model

    found: dict[Candidate, None] = {}

    class _Collector(cp_model.CpSolverSolutionCallback):
        def on_solution_callback(self) -> None:
            chains = [chain for chain in model.items.chains if self.boolean_value(chain.taken)]
            found[orders_of([(chain, self.value(chain.first.given)) for chain in chains], agents)] = None

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
    objective = solver.objective_value if found else math.inf
    return _Solved(list(found), objective, solver.best_objective_bound, status == cp_model.OPTIMAL)


def _complete_hint(model: Model) -> None:
    """Propose a value for every variable: with less, a large problem is not sure to take the proposed plan up."""
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
