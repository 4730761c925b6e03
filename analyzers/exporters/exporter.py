"""The base class of exporters, which write a table to a file of some format."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Final

from hrclog.errors import HrclogError
from hrclog.file_sets import replaced_set
from hrclog.files import output_errors, placed

if TYPE_CHECKING:
    import polars as pl

TABLES_SET: Final = "export"
"""The kind of the set of files that tables are."""


class Exporter(ABC):
    """Writes the tables of an analysis in a format: `hrclog export --format NAME`.

    Attributes:
        name: the name by which it is chosen.
        summary: one line for lists.
        suffix: the suffix of its files, with the dot.
    """

    name: ClassVar[str]
    summary: ClassVar[str] = ""
    suffix: ClassVar[str]

    @abstractmethod
    def write(self, frame: pl.DataFrame, path: Path) -> None:
        """Write a frame. docs/tables.md lists its columns; instants are int64 nanoseconds, and some columns are lists.

        Args:
            frame: one of the tables.
            path: of the file, in an existing folder; its name is the one asked for, and the folder a hidden one from
                which it is moved to its place when it is whole.

        Raises:
            OSError: the file cannot be written.
        """


def write_tables(exporter: Exporter, tables: Mapping[str, pl.DataFrame], folder: Path) -> list[tuple[Path, int]]:
    """Write tables to files of their names: all of them, or none.

    Args:
        exporter: writes them.
        tables: by name.
        folder: created if it is missing.

    Returns:
        The path and the number of rows of each.

    Raises:
        OutputError: a file cannot be written.
        HrclogError: the exporter failed.
    """
    with replaced_set(folder, TABLES_SET, keeps=True) as new:
        for table, frame in tables.items():
            fill_frame(exporter, frame, new / f"{table}{exporter.suffix}")
    return [(folder / f"{table}{exporter.suffix}", frame.height) for table, frame in tables.items()]


def write_table(exporter: Exporter, frame: pl.DataFrame, folder: Path, table: str) -> tuple[Path, int]:
    """Write a table to a file of its name; as `write_tables`, which has the errors too."""
    return write_tables(exporter, {table: frame}, folder)[0]


def write_frame(exporter: Exporter, frame: pl.DataFrame, path: Path) -> None:
    """Write a frame to a file, whose folder is created if it is missing.

    Raises:
        OutputError: the file cannot be written.
        HrclogError: the exporter failed.
    """
    with output_errors(path), placed(path) as hidden:
        fill_frame(exporter, frame, hidden)


def fill_frame(exporter: Exporter, frame: pl.DataFrame, path: Path) -> None:
    """Let an exporter write a frame to a file right where it is.

    Raises:
        OSError: the file cannot be written.
        HrclogError: the exporter failed.
    """
    try:
        exporter.write(frame, path)
    except (OSError, HrclogError):
        raise
    except Exception as error:
        raised = f"exporter {exporter.name!r} raised {type(error).__name__}: {error}"
        raise HrclogError(
            f"{path}: {raised}; `hrclog --debug export ...` shows where, or choose another --format"
        ) from error
