"""Options that take the name of something that users may add to."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from hrclog.errors import HrclogError
from hrclog.plugins import Registry

if TYPE_CHECKING:
    _NameType = click.ParamType[str]
else:
    _NameType = click.ParamType  # generic for type checkers alone in some versions of click


class NameOf(_NameType):
    """The name of a thing of one of some tables, or `package.module:NAME`, which may lie in the working folder.

    Args:
        registries: the tables, in order of preference.
    """

    name = "name"

    def __init__(self, *registries: Registry[Any]) -> None:
        self._registries = registries

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """Return the names for the help."""
        return f"[{'|'.join(self._names())}]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the name by which the thing is known.

        Raises:
            BadParameter: there is none, or it cannot be imported.
        """
        if value in self._names():
            return str(value)
        if ":" in value:
            try:
                return str(self._registries[0][value].name)
            except HrclogError as error:
                raise click.BadParameter(str(error), ctx, param) from error
        expected = ", ".join(map(repr, self._names()))
        problem = f"{value!r} is not one of {expected}, nor package.module:NAME of one of yours."
        raise click.BadParameter(problem, ctx, param)

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Return the names that begin as typed."""
        return [CompletionItem(name) for name in self._names() if name.startswith(incomplete)]

    def _names(self) -> list[str]:
        return [name for registry in self._registries for name in registry.names()]
