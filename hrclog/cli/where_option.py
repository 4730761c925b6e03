"""The option --where of every command that reads logs."""

from __future__ import annotations

from collections.abc import Callable

import click

from hrclog.cli.common import Command

_FORM = "KEY=VALUE|KEY!=VALUE"


def _checked(_context: click.Context, _parameter: click.Parameter, values: tuple[str, ...]) -> tuple[str, ...]:
    for value in values:
        key, sign, _ = value.partition("=")
        if not (sign and key.removesuffix("!").strip()):
            raise click.BadParameter(f"found {value!r}, expected {_FORM}, such as participant=P01")
    return values


def where_options(flag: str, name: str, help_text: str) -> Callable[[Command], Command]:
    """Return an option that takes conditions on tags."""
    return click.option(flag, name, multiple=True, metavar=_FORM, callback=_checked, help=help_text)


where_option = where_options(
    "--where",
    "conditions",
    "Read only runs whose tags are so. Repeatable: all must hold; equalities of one key are alternatives.",
)
