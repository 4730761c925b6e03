"""The option --tag of every command that makes logs."""

from __future__ import annotations

from typing import Any, Final

import click

from hrclog.errors import InvalidEventError
from hrclog.tags import checked_tags, parse_tags


def _by_key(_context: click.Context, _parameter: click.Parameter, values: tuple[str, ...]) -> dict[str, str]:
    """Return tags by key."""
    try:
        return checked_tags(parse_tags(values))
    except InvalidEventError as error:
        raise click.BadParameter(str(error)) from error


_SETTINGS: Final[dict[str, Any]] = {
    "multiple": True,
    "metavar": "KEY=VALUE",
    "callback": _by_key,
    "help": "A fact of every run, such as participant=P01; --where selects by it. Repeatable.",
}


def import_tag_option() -> click.Option:
    """Return the option for a command that is made of parts; its values are the argument `run_tags`."""
    return click.Option(["--tag", "run_tags"], **_SETTINGS)


tag_option = click.option("--tag", "tags", **_SETTINGS)
