"""Small random planning problems and their expected worlds, for laws that every search must keep."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from hypothesis import strategies as st

from hrclog.analyzers.search.space import Space, space_of
from hrclog.analyzers.search.worlds import Worlds, expected_world
from hrclog.knowledge.task_times import Factor, Gap, TaskTime, TaskTimes
from hrclog.planning.problem import Count, Precedence, PrecedenceKind, Problem, Task

_SYNERGIES = st.sampled_from([0.5, 0.8, 1.0, 1.0, 1.3, 2.0, 6.0, 20.0])
_WORKS = st.floats(0.5, 9.0).map(lambda value: round(value, 3))
_MOST = 400
"""Candidates of a problem, so that all can be judged."""


@st.composite
def problems(draw: st.DrawFn, agents: tuple[int, ...] = (1, 2, 3), *, rules: bool = True, dues: bool = True) -> Problem:
    """Draw problems of a few candidates.

    Args:
        draw: hypothesis.
        agents: how many there may be.
        rules: whether there may be precedences between agents, resources and release times.
        dues: whether there may be due times besides.
    """
    names = tuple("ABC"[: draw(st.sampled_from(agents))])
    domains = st.sets(st.sampled_from(names), min_size=1).map(lambda chosen: tuple(sorted(chosen)))
    tasks = [Task(f"t{n}", draw(domains)) for n in range(draw(st.integers(2, 4)))]
    counts = {task.name: draw(st.integers(1, 2)) for task in tasks}
    precedences: list[Precedence] = []
    if draw(st.booleans()):  # the last is placed after it was picked
        tasks.append(replace(tasks[-1], name="place"))
        counts["place"] = counts[tasks[-2].name]
        precedences.append(Precedence(tasks[-2].name, "place"))
    if rules:
        tasks = [_with_rules(draw, task, dues=dues) for task in tasks]
        precedences += _links(draw, counts)
    return Problem(names, tuple(tasks), tuple(Count(name, n) for name, n in counts.items()), tuple(precedences))


def _with_rules(draw: st.DrawFn, task: Task, *, dues: bool) -> Task:
    return replace(
        task,
        resources=draw(st.sampled_from([(), (), ("jig",)])),
        release_s=draw(st.sampled_from([0.0, 0.0, 4.5])),
        due_s=draw(st.sampled_from([None, None, 9.0, 15.0])) if dues else None,
    )


def _links(draw: st.DrawFn, counts: dict[str, int]) -> list[Precedence]:
    kind = draw(st.sampled_from([None, PrecedenceKind.EACH, PrecedenceKind.ALL]))
    if kind is None or (kind is PrecedenceKind.EACH and counts["t0"] < counts["t1"]):
        return []
    return [Precedence("t0", "t1", kind)]


def space_with(
    problem: Problem, work_s: dict[tuple[str, str], float], rate: float, gap_s: dict[str, float]
) -> tuple[Space, Worlds]:
    """Return the space of a problem, and a world in which whatever runs beside whatever is done at one rate."""
    times = {}
    for key, work in work_s.items():
        factors = tuple(Factor(*other, -math.log(rate), 9) for other in work_s if other[0] != key[0])
        times[key] = TaskTime(*key, math.log(work), 0.0, 9, factors, np.zeros((2 + len(factors),) * 2))
    gaps = {agent: Gap(agent, gap, 0.0, 9) for agent, gap in gap_s.items()}
    space = space_of(problem)
    return space, expected_world(TaskTimes(times, gaps), space.keys, space.agents, space.longest())


@st.composite
def spaces(
    draw: st.DrawFn, agents: tuple[int, ...] = (1, 2, 3), *, rules: bool = True, dues: bool = True
) -> tuple[Space, Worlds]:
    """Draw the space of a small problem, and its expected world; see `problems`."""
    space = draw(
        problems(agents, rules=rules, dues=dues).map(space_of).filter(lambda space: space.size(_MOST) <= _MOST)
    )
    keys = space.problem.agent_tasks()
    times = {key: _time(draw, key, keys) for key in keys}
    gaps = {agent: Gap(agent, draw(st.sampled_from([0.0, 0.1, 0.7313])), 0.0, 9) for agent in space.agents}
    return space, expected_world(TaskTimes(times, gaps), space.keys, space.agents, space.longest())


def _time(draw: st.DrawFn, key: tuple[str, str], keys: list[tuple[str, str]]) -> TaskTime:
    factors = tuple(Factor(*other, math.log(draw(_SYNERGIES)), 9) for other in keys if other[0] != key[0])
    return TaskTime(*key, math.log(draw(_WORKS)), 0.0, 9, factors, np.zeros((2 + len(factors),) * 2))
