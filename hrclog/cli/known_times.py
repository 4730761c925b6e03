"""Task times for a command: learnt, guessed or assumed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

if TYPE_CHECKING:
    from hrclog.knowledge.task_times import TaskTimes
    from hrclog.planning.problem import Problem

VARIABLE: Final = "HRCLOG_KB"

kb_option = click.option(
    "--kb",
    envvar=VARIABLE,
    metavar="KB",
    help=f"What was learnt: kb.sqlite or postgresql://USER@HOST/DATABASE.  [default: what {VARIABLE} says]",
)


def known_times(problem: Problem, kb: str | None, overrides: Path | None = None) -> TaskTimes:
    """Return the known times of a problem's tasks.

    Args:
        problem: its tasks may declare guesses, which win over those of a knowledge base.
        kb: a knowledge base; None for none.
        overrides: a file of factors that are supposed instead of those learnt.

    Raises:
        KnowledgeError: the knowledge base cannot be read.
        ScenarioError: the file cannot be read, or speaks of tasks of which nothing is known.
    """
    from hrclog.analyzers.search.what_if import read_overrides, with_overrides
    from hrclog.knowledge import open_knowledge
    from hrclog.knowledge.properties import guesses_s
    from hrclog.knowledge.task_times import NOTHING, with_guesses

    known, guesses = NOTHING, {}
    if kb:
        with open_knowledge(kb) as base:
            known, guesses = base.times(), guesses_s(base.properties())
    declared = {(agent, task.name): s for task in problem.tasks for agent, s in task.expected_s.items()}
    known = with_guesses(known, {**guesses, **declared})
    return with_overrides(known, read_overrides(overrides)) if overrides else known
