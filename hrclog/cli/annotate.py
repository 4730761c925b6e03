"""`hrclog annotate`: say something of runs afterwards; their logs are not rewritten."""

from __future__ import annotations

import click

from hrclog.cli.common import echo, json_option, logs_argument, print_json, tell
from hrclog.cli.where_option import where_option
from hrclog.errors import InvalidEventError
from hrclog.tags import parse_tags
from hrclog.wording import counted


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
    required=True,
    metavar="KEY=VALUE",
    callback=_tags,
    help="A fact of the runs, such as participant=P01; KEY= takes it back. Repeatable.",
)
@click.option("--run", "runs", multiple=True, metavar="NAME", help="Only runs of this name or id. Repeatable.")
@click.option("--author", default="", metavar="NAME", help="Who says it.")
@where_option
@json_option
def command(
    logs: tuple[str, ...],
    tags: dict[str, str | None],
    runs: tuple[str, ...],
    author: str,
    conditions: tuple[str, ...],
    as_json: bool,
) -> int:
    """Give runs tags afterwards. Their logs are not rewritten.

    What is said goes to RUN.annotations.mcap beside RUN.mcap and is read with it; keep the two together. What is said
    last holds.

    \b
    Example:
      hrclog annotate runs/monday_*.mcap --tag condition=baseline --tag session=1
    """
    from hrclog.recorders.annotate import annotate

    annotated = annotate(logs, tags, runs=runs, where=conditions, author=author)
    if as_json:
        named = [{"run_id": run, "name": name} for run, name in annotated.runs.items()]
        print_json({"runs": named, "tags": tags, "written": [str(path) for path in annotated.written]})
    else:
        facts = ", ".join(f"{key}={value}" if value else f"{key} taken back" for key, value in tags.items())
        echo(f"{counted(len(annotated.runs), 'run')}: {facts}")
    return tell(annotated.diagnostics)
