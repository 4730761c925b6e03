"""`hrclog report`: one HTML file to mail."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from hrclog.cli.common import (
    Progress,
    bootstrap_options,
    estimator_option,
    json_option,
    logs_argument,
    outliers_option,
    print_json,
    tell,
)
from hrclog.errors import HrclogError
from hrclog.wording import counted

if TYPE_CHECKING:
    from hrclog.analyzers.report.document import Report
    from hrclog.analyzers.report.save import PictureKind
    from hrclog.analyzers.result import Analysis

_MOST_LOGS_NAMED: Final = 5
_BAG_PARTS: Final = (".yaml", ".db3", ".mcap")
_PICTURES: Final[tuple[PictureKind, ...]] = ("png", "svg")


def _ending(*allowed: str) -> Any:
    """Return a check that a file's name ends so: a slip of the hand must not overwrite a log."""

    def check(_context: click.Context, _parameter: click.Parameter, value: Path | None) -> Path | None:
        if value is not None and value.suffix.lower() not in allowed:
            raise click.BadParameter(f"{str(value)!r} is no name for it, expected one that ends in {allowed[0]}")
        return value

    return check


@click.command(name="report")
@logs_argument
@click.option(
    "-o",
    "--output",
    default="report.html",
    show_default=True,
    type=click.Path(path_type=Path, dir_okay=False),
    callback=_ending(".html", ".htm"),
    help="The HTML file.",
)
@estimator_option
@outliers_option
@bootstrap_options(0)
@click.option(
    "--runs",
    default=4,
    show_default=True,
    type=click.IntRange(min=0),
    metavar="N",
    help="How many single runs are shown: the shortest, the longest, some between, and the one with most failures.",
)
@click.option("--title", default="", help="Title of the report.  [default: how many runs it is about]")
@click.option(
    "--pdf",
    type=click.Path(path_type=Path, dir_okay=False),
    callback=_ending(".pdf"),
    metavar="FILE",
    help="Write the figures as a PDF too, a page each.",
)
@click.option("--png", type=click.Path(path_type=Path), metavar="DIR", help="Write each figure as a PNG file too.")
@click.option("--svg", type=click.Path(path_type=Path), metavar="DIR", help="Write each figure as an SVG file too.")
@json_option
def command(**options: Any) -> int:
    """Write what recorded runs tell into one HTML file: findings, figures, tables, single runs, methods.

    LOG is a log, a folder of logs, a glob or a ROS bag. The file asks for nothing else, so it can be mailed; it works
    without JavaScript, and prints on A4.

    \b
    Example:
      hrclog report runs/*.mcap -o report.html --pdf figures.pdf
    """
    _check_folders(options)
    _check_logs_stay(options)
    analysis = _analysis(options)
    code = tell(analysis.diagnostics)
    from hrclog.analyzers.report.document import report

    said = report(analysis, runs=options["runs"], title=options["title"], command=_command(options))
    written = _write(said, options)
    if options["as_json"]:
        print_json(_facts(said, written))
    else:
        click.echo(_told(said, written))
    return code


def _check_folders(options: Mapping[str, Any]) -> None:
    """Raise before the work rather than after it, if a result cannot be written."""
    from hrclog.analyzers.output import check_writable

    for folder in (
        *(options[kind].parent for kind in ("output", "pdf") if options[kind]),
        options["png"],
        options["svg"],
    ):
        if folder is not None:
            check_writable(folder)


def _check_logs_stay(options: Mapping[str, Any]) -> None:
    """Raise before anything is written over a log, by its name or through a link."""
    from hrclog.log.discover import find_logs

    logs = {_file(part) for log in find_logs(options["logs"]) for part in (log, *_parts_of_bag(log))} - {None}
    targets = [(f"--{kind}", options[kind]) for kind in ("output", "pdf") if options[kind]]
    targets += [(f"--{kind}", path) for kind in _PICTURES if options[kind] for path in options[kind].glob(f"*.{kind}")]
    for option, path in targets:
        if _file(path) in logs:
            raise HrclogError(f"{path}: is one of the logs to read, so nothing was written; choose another {option}")


def _file(path: Path) -> tuple[int, int] | None:
    """Return which file a path leads to, through links too; None if to none."""
    try:
        found = path.stat()
    except (OSError, ValueError):  # ValueError: a name that no file can have
        return None
    return found.st_dev, found.st_ino


def _parts_of_bag(log: Path) -> Iterable[Path]:
    return (part for part in log.iterdir() if part.suffix in _BAG_PARTS) if log.is_dir() else ()


def _analysis(options: Mapping[str, Any]) -> Analysis:
    from hrclog.analyzers.analysis import analyze

    reading, draws = Progress("reading logs"), Progress("drawing runs anew", options["bootstrap"])
    analysis = analyze(
        options["logs"],
        options["estimator"],
        options["outliers"],
        reading,
        bootstrap=options["bootstrap"],
        seed=options["seed"],
        workers=options["workers"],
        on_draws=draws.advance,
    )
    draws.done()
    reading.done()
    return analysis


def _command(options: Mapping[str, Any]) -> str:
    """Return the command without what changes nothing in the report, so that the same runs give the same bytes."""
    usual = {parameter.name: parameter.default for parameter in command.params}
    kept = ("estimator", "outliers", *(("bootstrap", "seed") if options["bootstrap"] else ()), "runs", "title")
    return " ".join(
        [
            "hrclog report",
            _named(options["logs"]),
            *(f"--{name} {shlex.quote(str(options[name]))}" for name in kept if options[name] != usual[name]),
        ]
    )


def _named(logs: Sequence[str]) -> str:
    """Return the logs by name, or how many there are; their order changes nothing."""
    return shlex.join(sorted(logs)) if len(logs) <= _MOST_LOGS_NAMED else f"<{len(logs):,} logs>"


def _write(said: Report, options: Mapping[str, Any]) -> dict[str, list[Path]]:
    """Write what was asked for, and return the files by kind."""
    from hrclog.analyzers.report.save import write_pdf, write_pictures, write_report

    drawing = Progress("drawing figures")
    write_report(said, options["output"], drawing)
    written: dict[str, list[Path]] = {"html": [options["output"]]}
    if options["pdf"]:
        write_pdf(said, options["pdf"])
        written["pdf"] = [options["pdf"]]
    for kind in _PICTURES:
        if options[kind]:
            written[kind] = write_pictures(said, options[kind], kind, drawing)
    drawing.done()
    return written


def _facts(said: Report, written: Mapping[str, Sequence[Path]]) -> dict[str, Any]:
    """Return what the report says and where it is, for machines."""
    return {
        "title": said.title,
        "summary": said.summary,
        "findings": [asdict(finding) for finding in said.findings],
        "runs": [asdict(run) for run in said.chosen],
        "figures": [{"number": figure.number, "title": figure.plot.title} for figure in said.figures],
        "written": {kind: [str(path) for path in paths] for kind, paths in written.items()},
    }


def _told(said: Report, written: Mapping[str, Sequence[Path]]) -> str:
    counts = {"figure": len(said.figures), "table": len(said.tables), "single run": len(said.runs)}
    contents = ", ".join(counted(count, what) for what, count in counts.items())
    single, many = ("html", "pdf"), _PICTURES
    places = [str(path) for kind in single for path in written.get(kind, ())]
    places += [f"{written[kind][0].parent}/*.{kind}" for kind in many if kind in written]
    return f"{said.summary}\nWritten: {', '.join(places)} ({contents})"
