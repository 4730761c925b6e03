"""The importer of the paper authors' MongoDB dumps."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Final

from hrclog.recorders.importers.heads import without_compression
from hrclog.recorders.importers.importer import Foreign, Imported, Importer, Option, Remark
from hrclog.wording import agree, counted

_FIELDS: Final = (b'"recipe"', b'"agent"', b'"t_start"', b'"t_end"')


class Mongo(Importer):
    """The dumps of the paper's authors."""

    name = "mongo"
    summary = "Import task_results dumps of the paper authors' stack, one log per recipe."
    description = "Every id is derived from its row, so importing twice adds nothing."
    example = "hrclog import mongo task_results.json -o runs --report-gaps"
    options = (
        Option("report_gaps", "Report gaps in the numbering of the recipes: attempts deleted upstream.", bool, False),
        Option("ok", "Outcome that means succeeded, beside 1 (repeatable).", default=(), multiple=True),
        Option("failed", "Outcome that means failed, beside 0 (repeatable).", default=(), multiple=True),
        Option("canceled", "Outcome that means canceled (repeatable).", default=(), multiple=True),
    )

    def read(
        self,
        sources: Sequence[Path],
        *,
        ok: Sequence[str] = (),
        failed: Sequence[str] = (),
        canceled: Sequence[str] = (),
        **_: object,
    ) -> Foreign:
        """Return the runs of dumps, one per recipe.

        Raises:
            ImportDataError: no source is such a dump.
            HrclogError: an outcome is given two meanings.
        """
        from hrclog.recorders.importers.mongo_outcomes import Outcomes
        from hrclog.recorders.importers.mongo_runs import read_dumps

        return read_dumps(sources, Outcomes(ok, failed, canceled))

    def arguments_for(self, head: bytes, name: str) -> str | None:  # noqa: ARG002 - a dump is known by what it holds
        """Return what to type for a file whose first document has the fields of a task result."""
        text = without_compression(head)
        is_dump = text.lstrip(b"\xef\xbb\xbf \t\r\n[").startswith(b"{") and all(field in text for field in _FIELDS)
        return "-o logs" if is_dump else None

    def remark(self, imported: Imported, *, report_gaps: bool = False, **_: object) -> Remark:
        """Return the gaps in the numbering of the recipes, if they were asked for."""
        if not report_gaps:
            return Remark(values={"gaps": None})
        from hrclog.recorders.importers.gaps import gap_report

        gaps = gap_report(imported.runs)
        missing, attempts = sum(gap.n_missing for gap in gaps), sum(gap.n_attempts for gap in gaps)
        count_text = f"{missing:,} of {counted(attempts, 'attempt')} {agree(missing, 'is', 'are')} missing"
        text = f"{count_text} from the numbering (deleted upstream, probably failed):"
        rows = tuple((gap.prefix, str(gap.n_missing), str(gap.n_attempts)) for gap in gaps)
        values = [{"prefix": gap.prefix, "n_attempts": gap.n_attempts, "n_missing": gap.n_missing} for gap in gaps]
        return Remark(text, ("planner", "missing", "attempts"), rows, {"gaps": values})


def import_mongo(sources: Iterable[Path], folder: Path, on_run: Callable[[Path], None] = lambda _: None) -> Imported:
    """Write one log per recipe; a recipe whose log is there already is left alone.

    A source that cannot be read is a diagnostic beside the results of the others.

    Args:
        sources: dumps of task results.
        folder: where the logs go.
        on_run: called after each recipe, for progress.

    Raises:
        ImportDataError: no source is such a dump, or an existing log says something else than its recipe; then nothing
            is written.
        OutputError: the folder cannot be made.
    """
    from hrclog.recorders.importers.writing import import_files

    return import_files(Mongo(), list(sources), folder, on_run)
