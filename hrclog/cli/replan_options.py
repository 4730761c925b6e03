"""The options of a run that may change its plan on the way."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import click

from hrclog.cli.known_times import kb_option, known_times
from hrclog.recorders.dispatch.policy import ReplanOn

if TYPE_CHECKING:
    from hrclog.planning.problem import Problem
    from hrclog.planning.run_state import Replan

Command = TypeVar("Command", bound=Callable[..., Any])

_OPTIONS = (
    kb_option,
    click.option(
        "--replan-on",
        type=click.Choice([str(choice) for choice in ReplanOn]),
        multiple=True,
        help="Plan the rest again from --kb when an item has failed for good or is late (repeatable).",
    ),
    click.option(
        "--delay",
        "delay_s",
        type=click.FloatRange(min=0.0, min_open=True),
        metavar="S",
        help="How late an item may start or end before that.  [default: 5]",
    ),
)


def replan_options(command: Command) -> Command:
    """Add --kb, --replan-on and --delay to a command."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def chosen_replan(problem: Problem, kb: str | None, replan_on: tuple[str, ...]) -> Replan | None:
    """Return what plans the rest of a run, None if nobody is asked.

    Raises:
        HrclogError: a task of which nothing is known, or a knowledge base that cannot be read.
    """
    if not replan_on:
        return None
    from hrclog.analyzers.search.replan import replanner
    from hrclog.analyzers.search.worlds import expected_world

    times = known_times(problem, kb)
    expected_world(times, _keys(problem), problem.agents, 1)  # what is missing is told before the run, not in it
    return replanner(problem, times)


def _keys(problem: Problem) -> list[tuple[str, str]]:
    return [key for key in problem.agent_tasks() if not problem.is_extra(key[1]) and problem.total(key[1])]
