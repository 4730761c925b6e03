"""`hrclog annotate`: say something of runs afterwards; their logs are not rewritten."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from hrclog.cli.common import echo, json_option, logs_argument, print_json, tell
from hrclog.cli.where_option import where_option
from hrclog.errors import InvalidEventError
from hrclog.tags import parse_tags
from hrclog.wording import counted

if TYPE_CHECKING:
    from hrclog.recorders.annotate import Annotated

TARGET = "run|ID|FROM..TO"
_MOST_NAMED = 6


def _tags(_context: click.Context, _parameter: click.Parameter, values: tuple[str, ...]) -> dict[str, str | None]:
    """Return tags by key, None for one that is taken back."""
    try:
        return {key: value or None for key, value in parse_tags(values).items()}
    except InvalidEventError as error:
        raise click.BadParameter(str(error)) from error


@click.command(name="annotate")
@logs_argument
@click.option(
    "--tag",
    "tags",
    multiple=True,
    metavar="KEY=VALUE",
    callback=_tags,
    help="A fact of the runs, such as participant=P01; KEY= takes it back. Repeatable.",
)
@click.option(
    "--exclude",
    multiple=True,
    metavar=TARGET,
    help="A mistaken entry, which did not happen: the run, an execution's id, or all that has a part in a span. "
    "Repeatable.",
)
@click.option(
    "--not-learnt",
    multiple=True,
    metavar=TARGET,
    help="It happened, and disturbed others, but nothing is to be learnt from it. Repeatable.",
)
@click.option("--include", multiple=True, metavar=TARGET, help="Take one of these back. Repeatable.")
@click.option("--reason", default="", metavar="TEXT", help="Why; --exclude and --not-learnt need one.")
@click.option("--note", default="", metavar="TEXT", help="A remark on the runs.")
@click.option("--run", "runs", multiple=True, metavar="NAME", help="Only runs of this name or id. Repeatable.")
@click.option("--author", default="", metavar="NAME", help="Who says it.")
@where_option
@json_option
def command(
    logs: tuple[str, ...],
    tags: dict[str, str | None],
    exclude: tuple[str, ...],
    not_learnt: tuple[str, ...],
    include: tuple[str, ...],
    reason: str,
    note: str,
    runs: tuple[str, ...],
    author: str,
    conditions: tuple[str, ...],
    as_json: bool,
) -> int:
    """Say something of runs afterwards: tags, notes, and what is not to count. Their logs are not rewritten.

    What is said goes to RUN.annotations.mcap beside RUN.mcap and is read with it; keep the two together. What is said
    last holds. A span is FROM..TO, in seconds from the run's start or as instants.

    \b
    Example:
      hrclog annotate runs/monday_*.mcap --tag condition=baseline --tag session=1
      hrclog annotate runs/monday_3.mcap --exclude 62.5..70 --reason "the visitor pressed start"
    """
    from hrclog.recorders.annotate import annotate

    if note and reason:
        raise click.UsageError("--note is a remark by itself, --reason says why something is not to count")
    annotated = annotate(
        logs,
        tags,
        exclude=exclude,
        not_learnt=not_learnt,
        include=include,
        reason=reason or note,
        author=author,
        runs=runs,
        where=conditions,
    )
    if as_json:
        _print_json(annotated, tags)
    else:
        facts = [f"{key}={value}" if value else f"{key} taken back" for key, value in tags.items()]
        words = {"excluded": exclude, "not learnt from": not_learnt, "taken back": include}
        facts += [f"{', '.join(targets)} {word}" for word, targets in words.items() if targets]
        echo(f"{counted(len(annotated.runs), 'run')}: {', '.join(facts) or 'a note'}")
        if annotated.executions:
            echo(_executions_text(annotated))
    return tell(annotated.diagnostics)


def _executions_text(annotated: Annotated) -> str:
    """Return which executions are meant, so that a span of another time, or of another clock, is seen at once."""
    names = [f"{agent} {task}" for meant in annotated.executions.values() for agent, task in meant.values()]
    more = [f"{len(names) - _MOST_NAMED} more"] if len(names) > _MOST_NAMED else []
    return f"{counted(len(names), 'execution')}: {', '.join([*names[:_MOST_NAMED], *more])}"


def _print_json(annotated: Annotated, tags: dict[str, str | None]) -> None:
    runs = [
        {
            "run_id": run,
            "name": name,
            "judged": annotated.judged.get(run, []),
            "executions": list(annotated.executions.get(run, {})),
        }
        for run, name in annotated.runs.items()
    ]
    print_json({"runs": runs, "tags": tags, "written": [str(path) for path in annotated.written]})
