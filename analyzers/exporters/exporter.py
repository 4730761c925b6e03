"""The base class of exporters, which write a table to a file of some format."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from hrclog.errors import HrclogError, OutputError

if TYPE_CHECKING:
    import polars as pl


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
            path: of the file, in an existing folder.

        Raises:
            OSError: the file cannot be written.
        """


def write_table(exporter: Exporter, frame: pl.DataFrame, folder: Path, table: str) -> tuple[Path, int]:
    """Write a table to a file of its name.

    Args:
        exporter: writes it.
        frame: the table.
        folder: created if it is missing.
        table: the name of the table.

    Returns:
        The path and the number of rows.

    Raises:
        OutputError: the file cannot be written.
        HrclogError: the exporter failed.
    """
    path = folder / f"{table}{exporter.suffix}"
    write_frame(exporter, frame, path)
    return path, frame.height


def write_frame(exporter: Exporter, frame: pl.DataFrame, path: Path) -> None:
    """Write a frame to a file, whose folder is created if it is missing.

    Raises:
        OutputError: the file cannot be written.
        HrclogError: the exporter failed.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        exporter.write(frame, path)
    except OSError as error:
        raise OutputError(path, f"cannot be written ({error.strerror or error})") from error
    except HrclogError:
        raise
    except Exception as error:
        raised = f"exporter {exporter.name!r} raised {type(error).__name__}: {error}"
        raise HrclogError(
            f"{path}: {raised}; `hrclog --debug export ...` shows where, or choose another --format"
        ) from error
