"""The command line: one file per verb, imported when it is called."""

from __future__ import annotations

import importlib
import io
import keyword
import os
import sys
from collections.abc import Sequence
from typing import Any

import click

from hrclog._version import __version__
from hrclog.errors import HrclogError

VERBS = {
    "annotate": "Say something of runs afterwards: tags, notes, what is not to count.",
    "analyze": "Durations, overlaps, synergies and pictures of recorded runs.",
    "check": "Check logs for damage and doubtful data.",
    "compare": "Compare two sets of runs.",
    "demo": "Analyse the sample runs that come with hrclog.",
    "export": "Write executions and all other tables for R, SPSS and others.",
    "import": "Turn other systems' records into logs.",
    "info": "Show what a log holds.",
    "kb": "Store what was learned from runs, for planners to read.",
    "plan": "Find the best plan from what was learned, evaluate one, or draw random ones.",
    "record": "Record events given as JSON lines on standard input.",
    "recover": "Close logs whose recorder was killed.",
    "report": "Write findings, figures and tables into one HTML file that can be mailed.",
    "run": "Execute plans with simulated, replayed or scripted agents.",
    "score": "Score how well estimators predict runs they have not seen.",
    "sim": "Simulate runs of a cell and write their logs.",
    "view": "Open a log or a recording in the Rerun viewer, or follow runs as they are recorded.",
}


class LazyGroup(click.Group):
    """A group that imports a verb's module when the verb is used."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the verbs, sorted."""
        return sorted(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a verb's module and return its command."""
        if cmd_name not in VERBS:
            return None
        module = f"{cmd_name}_" if keyword.iskeyword(cmd_name) else cmd_name
        command: click.Command = importlib.import_module(f"hrclog.cli.{module}").command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the verbs without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl(sorted(VERBS.items()))


@click.command(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(__version__, prog_name="hrclog")
@click.option("--debug", is_flag=True, expose_value=False, help="Show tracebacks of errors.")
def cli() -> None:
    """Learn from runs of humans and robots that share a cell.

    Record or import runs as logs, then: hrclog analyze LOG...

    \b
    Example:
      hrclog demo
    """


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code: 0 fine, 1 failed, 2 usage, 3 data was lost or skipped."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    debug = "--debug" in arguments
    try:
        result: Any = cli.main(arguments, prog_name="hrclog", standalone_mode=False)
    except HrclogError as error:
        if debug:
            raise
        from hrclog.cli.hints import with_hint  # what it imports is not needed for --help

        _tell(f"hrclog: error: {with_hint(error)}")
        return 1
    except click.ClickException as error:
        with io.StringIO() as text:
            error.show(text)
            _tell(text.getvalue().removesuffix("\n"))
        return error.exit_code
    except click.Abort:
        _tell("hrclog: interrupted")
        return 130
    except OSError as error:
        # Code that opens a path raises HrclogError, so this error comes from standard output: its reader has closed it,
        # or the disk is full. The rest of the buffer cannot be written.
        if debug:
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        if not isinstance(error, BrokenPipeError):
            _tell(f"hrclog: error: the result could not be written ({error.strerror or error})")
        return 1
    return result if isinstance(result, int) else 0


def _tell(text: str) -> None:
    from hrclog.cli.common import echo_lines  # what it imports is not needed for --help

    echo_lines(text, err=True)
