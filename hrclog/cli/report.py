"""`hrclog report`: one HTML file to mail."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from hrclog.cli.clock_option import clock_option
from hrclog.cli.common import (
    Progress,
    bootstrap_options,
    echo_lines,
    estimator_option,
    json_option,
    logs_argument,
    outliers_option,
    print_json,
    tell,
)
from hrclog.cli.where_option import where_option
from hrclog.errors import HrclogError
from hrclog.log.clocks.offsets import offset_text
from hrclog.wording import counted

if TYPE_CHECKING:
    from hrclog.analyzers.report.document import Report
    from hrclog.analyzers.report.save import PictureKind
    from hrclog.analyzers.result import Analysis

_MOST_LOGS_NAMED: Final = 5
_BAG_PARTS: Final = (".yaml", ".db3", ".mcap")
_PICTURES: Final[tuple[PictureKind, ...]] = ("png", "svg")


def _ending_check(*allowed: str) -> Any:
    """Return a check of a file name's ending, so that a typing error cannot overwrite a log."""

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
    callback=_ending_check(".html", ".htm"),
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
    callback=_ending_check(".pdf"),
    metavar="FILE",
    help="Write the figures as a PDF too, a page each.",
)
@click.option("--png", type=click.Path(path_type=Path), metavar="DIR", help="Write each figure as a PNG file too.")
@click.option("--svg", type=click.Path(path_type=Path), metavar="DIR", help="Write each figure as an SVG file too.")
@clock_option
@where_option
@json_option
def command(**options: Any) -> int:
    """Write what recorded runs tell into one HTML file: findings, figures, tables, single runs, methods.

    LOG is a log, a folder of logs, a glob or a ROS bag. The file asks for nothing else, so it can be mailed; it works
    without JavaScript, and prints on A4.

    \b
    Example:
      hrclog report runs/*.mcap -o report.html --pdf figures.pdf
    """
    from hrclog.analyzers.output import check_finished

    for log in options["logs"]:
        check_finished(log)
    _check_folders(options)
    _check_logs_stay(options)
    analysis = _analysis(options)
    code = tell(analysis.diagnostics)
    from hrclog.analyzers.report.document import report

    document = report(analysis, runs=options["runs"], title=options["title"], command=_command(options))
    written = _write_files(document, options)
    if options["as_json"]:
        print_json(_report_json(document, written))
    else:
        echo_lines(_written_text(document, written))
    return code


def _check_folders(options: Mapping[str, Any]) -> None:
    """Raise before the analysis starts if a result cannot be written."""
    from hrclog.analyzers.output import check_writable

    for folder in (
        *(options[kind].parent for kind in ("output", "pdf") if options[kind]),
        options["png"],
        options["svg"],
    ):
        if folder is not None:
            check_writable(folder)


def _check_logs_stay(options: Mapping[str, Any]) -> None:
    """Raise if an output file is one of the logs, by name or through a link."""
    from hrclog.log.files.discover import find_logs

    logs = {_file_id(part) for log in find_logs(options["logs"]) for part in (log, *_parts_of_bag(log))} - {None}
    targets = [(f"--{kind}", options[kind]) for kind in ("output", "pdf") if options[kind]]
    targets += [(f"--{kind}", path) for kind in _PICTURES if options[kind] for path in options[kind].glob(f"*.{kind}")]
    for option, path in targets:
        if _file_id(path) in logs:
            raise HrclogError(f"{path}: is one of the logs to read, so nothing was written; choose another {option}")


def _file_id(path: Path) -> tuple[int, int] | None:
    """Return device and inode of the file behind a path, through links too; None if there is none."""
    try:
        status = path.stat()
    except (OSError, ValueError):  # ValueError: a name that no file can have
        return None
    return status.st_dev, status.st_ino


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
        clocks=options["clocks"],
        where=options["conditions"],
    )
    draws.done()
    reading.done()
    return analysis


def _command(options: Mapping[str, Any]) -> str:
    """Return the command without options that do not change the report, so that the same runs give the same bytes."""
    defaults = {parameter.name: parameter.default for parameter in command.params}
    names = ("estimator", "outliers", *(("bootstrap", "seed") if options["bootstrap"] else ()), "runs", "title")
    return " ".join(
        [
            "hrclog report",
            _logs_text(options["logs"]),
            *(f"--{name} {shlex.quote(str(options[name]))}" for name in names if options[name] != defaults[name]),
            *(
                f"--clock {shlex.quote(f'{agent}={offset_text(offset_ns)}')}"
                for agent, offset_ns in sorted(options["clocks"].items())
            ),
            *(f"--where {shlex.quote(text)}" for text in options["conditions"]),
        ]
    )


def _logs_text(logs: Sequence[str]) -> str:
    """Return the sorted names of the logs, or their number if there are many."""
    return shlex.join(sorted(logs)) if len(logs) <= _MOST_LOGS_NAMED else f"<{len(logs):,} logs>"


def _write_files(document: Report, options: Mapping[str, Any]) -> dict[str, list[Path]]:
    """Write the requested files and return their paths by kind."""
    from hrclog.analyzers.report.save import replaced_pictures, write_pdf, write_pictures, write_report
    from hrclog.files import output_errors, placed

    drawing = Progress("drawing figures")
    written: dict[str, list[Path]] = {"html": [options["output"]]}
    with ExitStack() as stack:  # nothing takes its place before all is drawn and written
        stack.enter_context(output_errors(options["output"]))
        write_report(document, stack.enter_context(placed(options["output"])), drawing)
        if options["pdf"]:
            write_pdf(document, stack.enter_context(placed(options["pdf"])))
            written["pdf"] = [options["pdf"]]
        for kind in _PICTURES:
            if options[kind]:
                folder = stack.enter_context(replaced_pictures(options[kind], kind))
                written[kind] = [options[kind] / name for name in write_pictures(document, folder, kind, drawing)]
    drawing.done()
    return written


def _report_json(document: Report, written: Mapping[str, Sequence[Path]]) -> dict[str, Any]:
    """Return the content of the report and its files as JSON values."""
    return {
        "title": document.title,
        "summary": document.summary,
        "findings": [asdict(finding) for finding in document.findings],
        "runs": [asdict(run) for run in document.chosen],
        "figures": [{"number": figure.number, "title": figure.plot.title} for figure in document.figures],
        "written": {kind: [str(path) for path in paths] for kind, paths in written.items()},
    }


def _written_text(document: Report, written: Mapping[str, Sequence[Path]]) -> str:
    counts = {"figure": len(document.figures), "table": len(document.tables), "single run": len(document.runs)}
    contents = ", ".join(counted(count, unit) for unit, count in counts.items())
    single, many = ("html", "pdf"), _PICTURES
    places = [str(path) for kind in single for path in written.get(kind, ())]
    places += [f"{written[kind][0].parent}/*.{kind}" for kind in many if kind in written]
    return f"{document.summary}\nWritten: {', '.join(places)} ({contents})"
