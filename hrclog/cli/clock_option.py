"""The option --clock of every command that reads logs."""

from __future__ import annotations

import click

from hrclog.log.clocks.offsets import OFFSET_FORM, parse_offset


def _by_agent(_context: click.Context, _parameter: click.Parameter, values: tuple[str, ...]) -> dict[str, int]:
    """Return by agent how far its clock is ahead, ns."""
    clocks: dict[str, int] = {}
    for value in values:
        agent, is_there, text = value.rpartition("=")  # an agent's name may hold the sign
        if not (is_there and agent):
            raise click.BadParameter(f"found {value!r}, expected AGENT=OFFSET, the offset as {OFFSET_FORM}")
        try:
            offset_ns = parse_offset(text)
        except ValueError as error:
            raise click.BadParameter(f"{value!r}: {error}") from error
        if clocks.setdefault(agent, offset_ns) != offset_ns:
            raise click.BadParameter(f"found two offsets of {agent!r}, expected one")
    return clocks


clock_option = click.option(
    "--clock",
    "clocks",
    multiple=True,
    metavar="AGENT=OFFSET",
    callback=_by_agent,
    help="How far an agent's clock is ahead, as diagnostics print it (human=+3600s); it is taken off. Repeatable.",
)
