"""`hrclog recover`: close what a killed recorder left."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hrclog.cli.common import EXIT_DATA_LOST, EXIT_FAILED, EXIT_FINE, echo, echo_lines, json_option, print_json
from hrclog.wording import counted

if TYPE_CHECKING:
    from hrclog.log.recover import Recovered


@click.command(name="recover")
@click.argument("journals", nargs=-1, required=True, metavar="LOG...", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), help="The finished log, for a single LOG.")
@json_option
def command(journals: tuple[Path, ...], output: Path | None, as_json: bool) -> int:
    """Close logs whose recorder was killed: every event that can be read, nothing invented.

    NAME.mcap.partial becomes NAME.mcap. Of a damaged log a NAME.recovered.mcap is written beside it, which keeps saying
    what was lost. Folders mean the journals in them, to any depth.

    \b
    Example:
      hrclog recover run.mcap.partial
    """
    sources = [source for journal in journals for source in _sources(journal)]
    if output and len(sources) != 1:
        raise click.UsageError(f"-o goes with one log, found {len(sources)}")
    if not sources:
        echo("no journals (*.mcap.partial) to recover", err=True)
    done, failures = _recover_all(sources, output)
    for failure in failures:
        echo_lines(f"error: {failure}", err=True)
    for result in done:
        for problem in result.problems:
            place = f"{result.source} (byte {problem.offset})"
            echo(f"error: {place}: {problem.message} [{problem.code}]", err=True)
        for text in result.earlier:
            echo(f"error: {result.source}: {text} [recovered_with_losses]", err=True)
    if as_json:
        print_json({"recovered": [_as_dict(result) for result in done], "failures": failures})
    else:
        for result in done:
            done_text = "closed already" if result.path == result.source else f"-> {result.path}"
            echo(f"{result.source} {done_text}: {counted(result.n_messages, 'message')}")
    if sources and not done:
        return EXIT_FAILED
    lossy = any(result.problems or result.earlier for result in done)
    return EXIT_DATA_LOST if failures or lossy else EXIT_FINE


def _recover_all(sources: list[Path], output: Path | None) -> tuple[list[Recovered], list[str]]:
    from hrclog.errors import HrclogError
    from hrclog.log.recover import recover

    done: list[Recovered] = []
    failures: list[str] = []
    for source in sources:
        try:
            done.append(recover(source, output))
        except HrclogError as error:
            failures.append(str(error))
    return done, failures


def _as_dict(result: Recovered) -> dict[str, Any]:
    return {
        "source": str(result.source),
        "path": str(result.path),
        "n_messages": result.n_messages,
        "n_problems": len(result.problems),
        "losses": [{"offset": problem.offset, "message": problem.message} for problem in result.problems],
        "earlier_losses": result.earlier,
    }


def _sources(path: Path) -> list[Path]:
    """Return the file itself, or the journals of a folder to any depth, those of bags too."""
    from hrclog.log.files.discover import find_logs
    from hrclog.log.files.names import is_journal_name

    if not path.is_dir():
        return [path]
    return [file for log in find_logs([path]) for file in _files_of(log) if is_journal_name(file.name)]


def _files_of(log: Path) -> list[Path]:
    from hrclog.errors import LogReadError
    from hrclog.log.bags.folder import is_bag, open_bag

    try:
        return open_bag(log).parts if is_bag(log) else [log]
    except LogReadError:  # a bag that has lost all its parts: there is nothing to close
        return []
