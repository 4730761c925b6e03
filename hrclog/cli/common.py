"""What the commands share: arguments, progress, tables and the printing of diagnostics."""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, Final, TypeVar

import click

from hrclog.analyzers.synergy.estimators import ESTIMATORS
from hrclog.analyzers.synergy.outlier_methods import OUTLIER_METHODS
from hrclog.cli.names import NameOf

if TYPE_CHECKING:
    from hrclog.diagnostic import Diagnostic

Command = TypeVar("Command", bound=Callable[..., Any])

EXIT_FINE: Final = 0
EXIT_FAILED: Final = 1
EXIT_DATA_LOST: Final = 3

FEWEST_DRAWS: Final = 40
"""Of a bootstrap; with fewer, no draw lies beyond a 95 % interval."""

_SHOWN_PER_CODE: Final = 5
_QUIET_SECONDS: Final = 1.0
_WIDEST_CELL: Final = 80

logs_argument = click.argument("logs", nargs=-1, required=True, metavar="LOG...", type=click.Path())
json_option = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON on standard output.")

estimator_option = click.option(
    "--estimator",
    type=NameOf(ESTIMATORS),
    default=ESTIMATORS.default,
    show_default=True,
    help="Method that estimates synergies; package.module:NAME for one of yours.",
)
outliers_option = click.option(
    "--outliers",
    type=NameOf(OUTLIER_METHODS),
    default=OUTLIER_METHODS.default,
    show_default=True,
    help="Which executions are left out before estimating.",
)


def _enough_draws(_context: click.Context, _parameter: click.Parameter, value: int) -> int:
    if 0 < value < FEWEST_DRAWS:
        raise click.BadParameter(
            f"{value} draws have no 95 % interval, expected at least {FEWEST_DRAWS}, or 0 for none"
        )
    return value


def bootstrap_options(default: int) -> Callable[[Command], Command]:
    """Add --bootstrap, --seed and --workers to a command.

    Args:
        default: how many draws.
    """

    def add(command: Command) -> Command:
        for option in (
            click.option(
                "--workers", type=click.IntRange(min=1), default=1, show_default=True, help="Processes for the draws."
            ),
            click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the draws."),
            click.option(
                "--bootstrap",
                type=click.IntRange(min=0),
                callback=_enough_draws,
                default=default,
                show_default=True,
                metavar="N",
                help="Take errors and intervals from N draws of whole runs.",
            ),
        ):
            command = option(command)
        return command

    return add


class Progress:
    """A line on standard error that appears when something takes longer than a second."""

    def __init__(self, label: str, total: int | None = None) -> None:
        self._label = label
        self._total = total
        self._count = 0
        self._since = time.monotonic()
        self._last = 0.0
        self._shown = False

    def __call__(self, *_: object) -> None:
        """Count one step."""
        self.advance(1)

    def advance(self, count: int) -> None:
        """Count several steps."""
        self._count += count
        now = time.monotonic()
        # sys.stderr is None if the caller has closed it
        if (
            sys.stderr is not None
            and sys.stderr.isatty()
            and now - self._since > _QUIET_SECONDS
            and now - self._last > 0.1
        ):
            self._last, self._shown = now, True
            of_total = f"/{self._total}" if self._total else ""
            click.echo(f"\r{self._label} {self._count}{of_total}", err=True, nl=False)

    def done(self) -> None:
        """Clear the line."""
        if self._shown:
            click.echo("\r\x1b[K", err=True, nl=False)


def echo(line: str = "", *, err: bool = False) -> None:
    """Print one line. What would control the terminal is escaped, line breaks too: names come from logs."""
    click.echo(printable(line), err=err)


def echo_lines(text: str, *, err: bool = False) -> None:
    """Print a text of several lines, such as a table; all but its line breaks is escaped as by `echo`."""
    click.echo("\n".join(map(printable, text.split("\n"))), err=err)


def echo_json(text: str) -> None:
    """Print a JSON text; what would control the terminal is escaped as JSON does it, so that values stay the same."""
    click.echo("\n".join(map(_printable_json, text.split("\n"))))


def print_json(value: Any, *, indent: int | None = 2) -> None:
    """Print a value as JSON on standard output."""
    echo_json(json.dumps(value, ensure_ascii=False, indent=indent, allow_nan=False))


def tell(diagnostics: Iterable[Diagnostic], *, info: bool = False, hints: bool = True) -> int:
    """Print findings on standard error, the first few of each kind, and return the exit code they ask for.

    Args:
        diagnostics: the findings.
        info: facts too.
        hints: say of files that are no logs which command imports them.
    """
    from hrclog.cli.hints import hinted
    from hrclog.diagnostic import ALWAYS_TOLD, loses_data

    rank = {"error": 0, "warning": 1, "info": 2}
    ordered = sorted(diagnostics, key=lambda diagnostic: rank[diagnostic.severity])
    shown: Counter[str] = Counter()
    for diagnostic in ordered:
        if diagnostic.severity == "info" and not info and diagnostic.code not in ALWAYS_TOLD:
            continue
        shown[diagnostic.code] += 1
        if shown[diagnostic.code] <= _SHOWN_PER_CODE:
            echo(str(*(hinted([diagnostic]) if hints else [diagnostic])), err=True)
    for code, count in shown.items():
        if count > _SHOWN_PER_CODE:
            echo(f"... and {count - _SHOWN_PER_CODE} more [{code}]", err=True)
    return EXIT_DATA_LOST if loses_data(ordered) else EXIT_FINE


def table(
    header: Sequence[str], rows: Iterable[Sequence[str]], numeric: Callable[[int], bool] = lambda i: i > 0
) -> str:
    """Return aligned columns; `numeric` says which to align right."""
    lines = [tuple(header), *(tuple(shortened(printable(cell)) for cell in row) for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(header))]
    lines.insert(1, tuple("-" * width for width in widths))
    return "\n".join(
        "  ".join(
            cell.rjust(width) if numeric(i) else cell.ljust(width)
            for i, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    )


def shortened(text: str) -> str:
    """Return a text shortened to leave room for the other columns; the files hold the full text."""
    if len(text) <= _WIDEST_CELL:
        return text
    return f"{text[: _WIDEST_CELL // 2]}…{text[1 - _WIDEST_CELL // 2 :]}"


def printable(text: str) -> str:
    """Return a text without control characters: names in logs must not control the terminal."""
    if text.isprintable():
        return text
    return "".join(char if char.isprintable() else char.encode("unicode_escape").decode() for char in text)


def _printable_json(line: str) -> str:
    if line.isprintable():
        return line
    return "".join(char if char.isprintable() else json.dumps(char)[1:-1].replace("\x7f", "\\u007f") for char in line)


def number(value: float | None, digits: int = 2) -> str:
    """Return a number for a table, n/a where there is none."""
    return "n/a" if value is None else f"{value:.{digits}f}"
