"""Options that take the code of a diagnostic."""

from __future__ import annotations

from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, Final

import click
from click.shell_completion import CompletionItem

from hrclog.diagnostic import CODES

if TYPE_CHECKING:
    _NameType = click.ParamType[str]
else:
    _NameType = click.ParamType  # generic for type checkers alone in some versions of click

_MOST_NEAR: Final = 5


class DiagnosticCode(_NameType):
    """A code of `hrclog.diagnostic.CODES`."""

    name = "code"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the code.

        Raises:
            BadParameter: there is none of that name; the message lists those that are near.
        """
        if value in CODES:
            return str(value)
        near = _near(value)
        hint = f"did you mean {', '.join(near)}?" if near else "docs/diagnostics.md lists the codes."
        raise click.BadParameter(f"{value!r} is no code of a diagnostic; {hint}", ctx, param)

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Return the codes that begin as typed."""
        return [CompletionItem(code) for code in CODES if code.startswith(incomplete)]


def _near(value: str) -> list[str]:
    """Return codes that are spelt nearly like a text, or share a part with it."""
    typed = value.lower().replace("-", "_")
    alike = get_close_matches(typed, CODES, _MOST_NEAR)
    parts = {part for part in typed.split("_") if len(part) > 2}
    sharing = [code for code in CODES if parts.intersection(code.split("_"))]
    return list(dict.fromkeys([*alike, *sharing]))[:_MOST_NEAR]
