"""The base class of importers, which turn files of another system into the events of runs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from hrclog.diagnostic import Diagnostic
from hrclog.events import Event

if TYPE_CHECKING:  # these cost the import of polars, and importers are listed by `--help`
    import polars as pl

    from hrclog.log.messages.encode import Signal


@dataclass(frozen=True, slots=True)
class Option:
    """An option of an importer on the command line.

    Attributes:
        name: of the argument that `read` gets it as; `report_gaps` is `--report-gaps`.
        help: what it is for.
        kind: `bool` makes a flag; else what a text is turned into.
        default: where it is not given; with `multiple`, a tuple.
        multiple: whether it may be given several times.
        only_shows: of a flag, whether it asks for something to be shown, and for no import.
    """

    name: str
    help: str
    kind: type[bool | str | int | float | Path] = str
    default: Any = None
    multiple: bool = False
    only_shows: bool = False


@dataclass(frozen=True, slots=True)
class Reading:
    """How files were read: what follows the counts of runs and executions, lines for people, and values for JSON."""

    text: str = ""
    lines: str = ""
    values: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Foreign:
    """What the files of another system hold.

    Attributes:
        names: of the runs, each once; in this order their logs are written.
        events: returns the events of a run by its name: `run_started` first, in order of time, all of one run id.
        n_executions: how many executions all runs hold.
        diagnostics: what could not be taken over, and why.
        signals: returns the samples of a run by its name, in order of time.
        columns: the events of all runs as columns, where they are at hand: an events frame in order, and where each run
            lies in it. They are written faster, and equal what `events` returns.
        reading: what is to be said of how the files were read.
    """

    names: Sequence[str]
    events: Callable[[str], Sequence[Event]]
    n_executions: int = 0
    diagnostics: Sequence[Diagnostic] = ()
    signals: Callable[[str], Sequence[Signal]] = lambda _: ()
    columns: tuple[pl.DataFrame, Mapping[str, tuple[int, int]]] | None = None
    reading: Reading = field(default_factory=Reading)


@dataclass(frozen=True, slots=True)
class Imported:
    """The result of an import: logs written, logs that existed unchanged, and the names of all runs in order."""

    written: list[Path] = field(default_factory=list)
    unchanged: list[Path] = field(default_factory=list)
    n_executions: int = 0
    diagnostics: list[Diagnostic] = field(default_factory=list)
    runs: list[str] = field(default_factory=list)
    reading: Reading = field(default_factory=Reading)


@dataclass(frozen=True, slots=True)
class Remark:
    """What an importer reports beside the logs: a line and a table for people, and the same as values for JSON."""

    text: str = ""
    header: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    values: Mapping[str, Any] = field(default_factory=dict)


class Importer(ABC):
    """Reads the files of another system. `writing.import_files` writes the logs.

    Derive every id from the source (`hrclog.ids.derived_id`), so that importing twice adds nothing. The module of the
    class is imported for every help and hint: let it import what costs time where it is used.

    Attributes:
        name: by which it is chosen: `hrclog import NAME`.
        summary: one line for lists.
        description: what follows it in the help.
        example: a command line.
        options: those it has beside the files and the folder.
    """

    name: ClassVar[str]
    summary: ClassVar[str] = ""
    description: ClassVar[str] = ""
    example: ClassVar[str] = ""
    options: ClassVar[tuple[Option, ...]] = ()

    @abstractmethod
    def read(self, sources: Sequence[Path], **options: Any) -> Foreign:  # noqa: ANN401 - what its options hold
        """Return what the files hold; one bad file among several is a diagnostic.

        Args:
            sources: the files.
            options: one for each of `options`, by name.

        Raises:
            ImportDataError: no file can be read.
        """

    def arguments_for(self, head: bytes, name: str) -> str | None:  # noqa: ARG002 - for those that need them
        """Return what to type behind a file's name to import it, None where it does not look like one of this system.

        Args:
            head: its first bytes, `heads.HEAD_BYTES` or all it has; `heads.without_compression` unpacks them.
            name: of the file.
        """
        return None

    def preview(self, sources: Sequence[Path], **options: Any) -> Imported | Remark | None:  # noqa: ANN401, ARG002 - for those that need them
        """Return what is shown where nothing is to be written: no folder is given, or an option that `only_shows`.

        Args:
            sources: the files.
            options: as for `read`.

        Returns:
            What an import would do, or something else to be said; None where a folder is needed.
        """
        return None

    def remark(self, imported: Imported, **options: Any) -> Remark:  # noqa: ANN401, ARG002 - for those that need them
        """Return what else is to be said of an import.

        Args:
            imported: what it did.
            options: as for `read`.
        """
        return Remark()
