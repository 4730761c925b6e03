"""`hrclog kb`: the knowledge base."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hrclog.analyzers.synergy.estimators import ESTIMATORS
from hrclog.analyzers.synergy.outlier_methods import OUTLIER_METHODS
from hrclog.cli.clock_option import clock_option
from hrclog.cli.common import EXIT_FINE, Progress, echo_lines, json_option, logs_argument, print_json, tell
from hrclog.cli.known_times import VARIABLE
from hrclog.cli.names import NameOf
from hrclog.cli.where_option import where_option
from hrclog.wording import counted

if TYPE_CHECKING:
    from hrclog.analyzers.learning.ingest import Ingested
    from hrclog.diagnostic import Diagnostic
    from hrclog.knowledge.base import KnowledgeBase


def _require_place(_context: click.Context, _parameter: click.Parameter, value: str | None) -> str:
    place = value or os.environ.get(VARIABLE, "")
    if not place:
        raise click.UsageError(f"no knowledge base is named: give --kb KB, or set {VARIABLE}")
    return place


kb_option = click.option(
    "--kb",
    "where",
    metavar="KB",
    callback=_require_place,
    help=f"kb.sqlite or postgresql://USER@HOST/DATABASE.  [default: what {VARIABLE} says]",
)
estimator_option = click.option(
    "--estimator",
    type=NameOf(ESTIMATORS),
    help=f"How synergies are estimated.  [default: as before, at first {ESTIMATORS.default}]",
)
outliers_option = click.option(
    "--outliers",
    type=NameOf(OUTLIER_METHODS),
    help=f"Which executions are left out before estimating.  [default: as before, at first {OUTLIER_METHODS.default}]",
)


@click.group(name="kb")
def command() -> None:
    """Store what was learned from runs, for planners to read.

    The logs are the truth; a knowledge base is made from them, in SQLite or PostgreSQL, and can be made anew.
    """


@command.command(name="ingest")
@logs_argument
@kb_option
@clock_option
@where_option
@json_option
def ingest(
    logs: tuple[str, ...], where: str, clocks: dict[str, int], conditions: tuple[str, ...], as_json: bool
) -> int:
    """Take in the runs of logs; what was taken in before adds nothing. Statistics stay as they are.

    \b
    Example:
      hrclog kb ingest runs/*.mcap --kb kb.sqlite
    """
    with _open_kb(where, create=True) as kb:
        ingested = _ingest(kb, logs, clocks, conditions)
        _print_result(_ingested_json(ingested), _ingested_text(ingested), as_json=as_json)
    return tell(ingested.diagnostics)


@command.command(name="update")
@click.argument("logs", nargs=-1, metavar="[LOG...]", type=click.Path())
@kb_option
@estimator_option
@outliers_option
@clock_option
@where_option
@json_option
def update(
    logs: tuple[str, ...],
    where: str,
    estimator: str | None,
    outliers: str | None,
    clocks: dict[str, int],
    conditions: tuple[str, ...],
    as_json: bool,
) -> int:
    """Bring statistics up to date; runs of the logs given are taken in first.

    \b
    Example:
      hrclog kb update runs/*.mcap --kb kb.sqlite
    """
    from hrclog.analyzers.learning.ingest import Ingested, update_statistics

    if (clocks or conditions) and not logs:
        raise click.UsageError(f"{'--clock' if clocks else '--where'} goes with LOG...")
    with _open_kb(where, create=bool(logs)) as kb:
        ingested = _ingest(kb, logs, clocks, conditions) if logs else Ingested()
        changed = update_statistics(kb, estimator, outliers)
        doubts = _doubts(kb)
        statistics_text = "statistics updated" if changed else "statistics are up to date"
        sentence = f"{_ingested_text(ingested)}; {statistics_text}" if logs else statistics_text
        _print_result(
            _ingested_json(ingested) | {"updated": changed, "statistics": _statistics_json(kb)},
            sentence,
            as_json=as_json,
        )
    return tell([*ingested.diagnostics, *doubts])


@command.command(name="show")
@kb_option
@json_option
def show(where: str, as_json: bool) -> int:
    """Show runs, durations and synergies, what they were made from, and declared guesses.

    \b
    Example:
      hrclog kb show --kb kb.sqlite
    """
    from hrclog.cli.kb_text import contents, contents_text

    with _open_kb(where) as kb, kb.view() as view:
        if as_json:
            print_json(contents(view))
        else:
            echo_lines(contents_text(view))
    return EXIT_FINE


@command.command(name="withdraw")
@click.argument("run")
@kb_option
@click.option("--reason", default="", help="Why; kept beside the run.")
@click.option("--undo", is_flag=True, help="Take it back into statistics.")
@json_option
def withdraw(run: str, where: str, reason: str, undo: bool, as_json: bool) -> int:
    """Leave a run, named by its id or name, out of statistics, also if it is given again.

    \b
    Example:
      hrclog kb withdraw paper_0003 --reason "the gripper was loose" --kb kb.sqlite
    """
    from hrclog.analyzers.learning.ingest import update_statistics

    if undo and reason:
        raise click.UsageError("--reason does not go with --undo")
    with _open_kb(where) as kb:
        run_id = kb.undo_withdrawal(run) if undo else kb.withdraw(run, reason)
        changed = update_statistics(kb)
        change = "counts again" if undo else "is withdrawn"
        sentence = f"{run} {change}; " + ("statistics updated" if changed else "statistics are as before")
        _print_result({"run_id": run_id, "withdrawn": not undo, "updated": changed}, sentence, as_json=as_json)
    return EXIT_FINE


@command.command(name="export")
@kb_option
@click.option("-o", "--output", type=click.Path(path_type=Path), metavar="DIR", help="Folder for the files.")
@click.option(
    "--format", "kind", type=click.Choice(["json", "parquet"]), default="json", show_default=True, help="Of the files."
)
@click.option("--to", "target", metavar="URL", help="mongodb://USER@HOST/DATABASE to write copies to.")
@json_option
def export(where: str, output: Path | None, kind: str, target: str | None, as_json: bool) -> int:
    """Write the collections task_properties, task_results, task_durations and task_synergies.

    JSON has the shapes of the paper authors' stack, and `hrclog kb import` reads it back.

    \b
    Example:
      hrclog kb export --kb kb.sqlite -o exported
    """
    if bool(output) == bool(target):
        raise click.UsageError("expected either -o DIR or --to mongodb://...")
    with _open_kb(where) as kb:
        if target:
            from hrclog.knowledge.mongo import export_mongo

            counts = export_mongo(kb, target)
            written = [{"collection": name, "documents": count} for name, count in counts.items()]
            lines = [f"{name}: {counted(count, 'document')}" for name, count in counts.items()]
        else:
            from hrclog.knowledge.exchange import export_json, export_parquet

            assert output is not None  # noqa: S101 - either is given
            files = (export_json if kind == "json" else export_parquet)(kb, output)
            written = [{"path": str(path), "rows": count} for path, count in files]
            unit = "document" if kind == "json" else "row"
            lines = [f"{path}: {counted(count, unit)}" for path, count in files]
    _print_result({"written": written}, "\n".join(lines), as_json=as_json)
    return EXIT_FINE


@command.command(name="import")
@click.argument("source", metavar="DIR", type=click.Path(path_type=Path))
@kb_option
@json_option
def import_(source: Path, where: str, as_json: bool) -> int:
    """Take in what `hrclog kb export` wrote, or the paper authors' dumps task_results.json and task_properties.json.

    \b
    Example:
      hrclog kb import exported --kb kb.sqlite
    """
    from hrclog.analyzers.learning.ingest import update_statistics
    from hrclog.cli.kb_import import import_folder

    with _open_kb(where, create=True) as kb:
        ingested, method = import_folder(kb, source)
        changed = update_statistics(kb, *method)
        doubts = _doubts(kb)
        sentence = f"{_ingested_text(ingested)}; " + ("statistics updated" if changed else "statistics are up to date")
        _print_result(
            _ingested_json(ingested) | {"updated": changed, "statistics": _statistics_json(kb)},
            sentence,
            as_json=as_json,
        )
    return tell([*ingested.diagnostics, *doubts])


@command.command(name="rebuild")
@logs_argument
@kb_option
@estimator_option
@outliers_option
@clock_option
@where_option
@json_option
def rebuild(
    logs: tuple[str, ...],
    where: str,
    estimator: str | None,
    outliers: str | None,
    clocks: dict[str, int],
    conditions: tuple[str, ...],
    as_json: bool,
) -> int:
    """Rebuild everything from logs and swap it in at once; withdrawals stay.

    \b
    Example:
      hrclog kb rebuild runs/*.mcap --kb kb.sqlite
    """
    from hrclog.analyzers.learning.ingest import rebuild as rebuild_from

    reading = Progress("reading logs")
    with _open_kb(where, create=True) as kb:
        try:
            ingested = rebuild_from(kb, logs, estimator, outliers, reading, clocks=clocks, where=conditions)
        finally:
            reading.done()
        doubts = _doubts(kb)
        sentence = f"made anew from {counted(len(ingested.added), 'run')}"
        _print_result({"runs": ingested.added, "statistics": _statistics_json(kb)}, sentence, as_json=as_json)
    return tell([*ingested.diagnostics, *doubts])


@contextmanager
def _open_kb(where: str, *, create: bool = False) -> Iterator[KnowledgeBase]:
    from hrclog.knowledge import open_knowledge

    with open_knowledge(where, create=create) as kb:
        yield kb


def _ingest(kb: KnowledgeBase, logs: tuple[str, ...], clocks: dict[str, int], conditions: tuple[str, ...]) -> Ingested:
    from hrclog.analyzers.learning.ingest import ingest_logs

    reading = Progress("reading logs")
    try:
        return ingest_logs(kb, logs, reading, clocks=clocks, where=conditions)
    finally:
        reading.done()


def _ingested_json(ingested: Ingested) -> dict[str, Any]:
    return {
        "added": ingested.added,
        "replaced": ingested.replaced,
        "unchanged": ingested.unchanged,
        "diagnostics": [finding.as_dict() for finding in ingested.diagnostics],
    }


def _ingested_text(ingested: Ingested) -> str:
    replaced = f", {len(ingested.replaced)} replaced by a later version" if ingested.replaced else ""
    return f"{counted(len(ingested.added), 'run')} added{replaced}, {len(ingested.unchanged)} there already"


def _doubts(kb: KnowledgeBase) -> list[Diagnostic]:
    """Return what is doubtful about the statistics that plans will be judged by."""
    from hrclog.analyzers.projections.lints.impossible_factors import impossible_factors

    with kb.view() as view:
        return impossible_factors(view.synergies())


def _statistics_json(kb: KnowledgeBase) -> dict[str, Any] | None:
    from hrclog.cli.kb_text import made_from

    return made_from(kb.statistics())


def _print_result(document: dict[str, Any], sentence: str, *, as_json: bool) -> None:
    if as_json:
        print_json(document)
    else:
        echo_lines(sentence)
