"""The option --tag of every command that makes logs."""

from __future__ import annotations

import click

from hrclog.errors import InvalidEventError
from hrclog.tags import checked_tags, parse_tags


def _by_key(_context: click.Context, _parameter: click.Parameter, values: tuple[str, ...]) -> dict[str, str]:
    """Return tags by key."""
    try:
        return checked_tags(parse_tags(values))
    except InvalidEventError as error:
        raise click.BadParameter(str(error)) from error


def tag_option(name: str = "tags") -> click.Option:
    """Return the option; its values by key are the argument of that name."""
    return click.Option(
        ["--tag", name],
        multiple=True,
        metavar="KEY=VALUE",
        callback=_by_key,
        help="A fact of every run, such as participant=P01; `--where` selects by it. Repeatable.",
    )
