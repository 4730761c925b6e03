"""`hrclog import`: other systems' records into logs; a command per importer, made from its record."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import click

from hrclog.cli.common import Progress, echo, echo_lines, print_json, table, tell
from hrclog.cli.hints import joined, other_importer_line
from hrclog.cli.tag_option import import_tag_option
from hrclog.errors import HrclogError, ImportDataError
from hrclog.recorders.importers.importer import Imported, Importer, Option, Remark
from hrclog.recorders.importers.importers import IMPORTERS
from hrclog.wording import agree, counted, share

_DRY_RUN: Final = Option("dry_run", "Say what would be imported, and write no log.", bool, False)


class Importers(click.Group):
    """A group whose commands are the importers there are."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return their names."""
        return IMPORTERS.names()

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return the command of an importer, by its name or as `package.module:NAME`."""
        if cmd_name not in IMPORTERS and ":" not in cmd_name:
            return None
        return _command(IMPORTERS[cmd_name])


@click.command(name="import", cls=Importers)
def command() -> None:
    """Turn other systems' records into logs."""


def _command(importer: Importer) -> click.Command:
    example = f"\b\nExample:\n  {importer.example}" if importer.example else ""
    return click.Command(
        importer.name,
        callback=_callback(importer),
        help="\n\n".join(part for part in (importer.summary, importer.description, example) if part),
        short_help=importer.summary,
        params=[
            click.Argument(["sources"], nargs=-1, required=True, metavar="FILE...", type=click.Path(path_type=Path)),
            click.Option(["-o", "--output"], type=click.Path(path_type=Path), help="Folder for the logs."),
            *map(_option, importer.options),
            *([] if _takes_tags(importer) else [import_tag_option()]),
            _option(_DRY_RUN),
            click.Option(["--json", "as_json"], is_flag=True, help="Print the result as JSON on standard output."),
        ],
    )


def _takes_tags(importer: Importer) -> bool:
    """Return whether an importer has tags of its own making; all others are given those of `--tag`."""
    return any(option.name == "tag" for option in importer.options)


def _option(option: Option) -> click.Option:
    flag = f"--{option.name.replace('_', '-')}"
    if option.kind is bool:
        return click.Option([flag, option.name], is_flag=True, default=bool(option.default), help=option.help)
    kind = click.Path(path_type=Path) if option.kind is Path else option.kind
    return click.Option(
        [flag, option.name], type=kind, default=option.default, multiple=option.multiple, help=option.help
    )


def _answer(imported: Imported, folder: Path | None, n_sources: int) -> list[str]:
    """Return the lines that say what was imported; without a folder, what would be."""
    counts = f"{counted(len(imported.runs), 'run')}, {counted(imported.n_executions, 'execution')}"
    n_failed = len({finding.path for finding in imported.diagnostics if finding.code == "unreadable_file"})
    if n_failed and n_sources > 1:
        failed = share(min(n_failed, n_sources), n_sources, "file")
        counts = f"{failed} could not be read, and {agree(n_failed, 'its', 'their')} runs are missing: {counts}"
    reading = imported.reading
    logs = (
        "no log written: -o FOLDER writes them"
        if folder is None
        else f"{counted(len(imported.written), 'log')} written to {folder}, {len(imported.unchanged)} there already"
    )
    if not reading.text:
        return [f"{counts}: {logs}"]
    return [f"{counts}; {reading.text}", *reading.lines.splitlines(), logs]


def _callback(importer: Importer) -> Any:
    def run(sources: Sequence[Path], output: Path | None, as_json: bool, **options: Any) -> int:
        try:
            return do_import(sources, output, as_json, **options)
        except ImportDataError as error:
            is_of_output = output is not None and output in error.path.parents  # a log that is there, no source
            other = "" if is_of_output else other_importer_line(error.path, importer.name)
            if other:
                raise HrclogError(joined(str(error), other)) from error
            raise

    def do_import(
        sources: Sequence[Path], output: Path | None, as_json: bool, *, dry_run: bool = False, **options: Any
    ) -> int:
        from hrclog.recorders.importers.writing import import_files

        only_shows = any(options[option.name] for option in importer.options if option.only_shows)
        if output is None or dry_run or only_shows:
            shown = importer.preview(sources, **options)
            if isinstance(shown, Remark):
                _show(shown, as_json=as_json)
                return 0
            if shown is None and not dry_run:
                raise click.MissingParameter(param_hint="'-o' / '--output'", param_type="option")
            imported, output = shown or import_files(importer, sources, None, **options), None
        else:
            importing = Progress("importing runs")
            imported = import_files(importer, sources, output, importing, **options)
            importing.done()
        remark = importer.remark(imported, **options)
        if as_json:
            print_json(_values(imported, remark))
        else:
            for line in _answer(imported, output, len(sources)):
                echo(line)
            _show(remark)
        return tell(imported.diagnostics, hints=False)

    return run


def _values(imported: Imported, remark: Remark) -> dict[str, Any]:
    return {
        "n_runs": len(imported.runs),
        "n_executions": imported.n_executions,
        "written": [str(path) for path in imported.written],
        "unchanged": [str(path) for path in imported.unchanged],
        **imported.reading.values,
        **remark.values,
        "diagnostics": [diagnostic.as_dict() for diagnostic in imported.diagnostics],
    }


def _show(remark: Remark, *, as_json: bool = False) -> None:
    if as_json:
        print_json(remark.values)
        return
    if remark.text:
        echo_lines(remark.text)
    if remark.rows:
        echo_lines(table(remark.header, remark.rows))
