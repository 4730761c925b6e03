"""Tables as files of SPSS."""

from __future__ import annotations

import errno
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import polars as pl

from hrclog.analyzers.exporters.exporter import Exporter
from hrclog.errors import HrclogError

_LONGEST_NAME: Final = 64  # bytes, of a variable
_LONGEST_LABEL: Final = 255  # bytes
_LONGEST_TEXT: Final = 32_767  # bytes
_NO_SPACE: Final = "Unable to write data"  # what pyreadstat says, in an error that says no more
_EXACT: Final = 2**53
"""Numbers of SPSS are doubles, which hold no larger integer exactly."""
_NOT_IN_NAMES: Final = re.compile(r"\W")
_RESERVED: Final = frozenset("ALL AND BY EQ GE GT LE LT NE NOT OR TO WITH".split())  # noqa: SIM905 - a list that is read


class Spss(Exporter):
    """SPSS, also read by PSPP, Jamovi and JASP.

    Names become legal ones, with the whole name as label. Lists become texts joined by "|", texts are cut at 32,767
    bytes, and a column with integers that a double does not hold, such as instants in ns, becomes one of texts.
    """

    name = "spss"
    summary = "SPSS, PSPP, Jamovi, JASP (pip install 'hrclog[spss]')"
    suffix = ".sav"

    def write(self, frame: pl.DataFrame, path: Path) -> None:
        """Write a frame.

        Raises:
            HrclogError: pyreadstat is not installed.
        """
        try:
            import pyreadstat
        except ImportError as error:
            raise HrclogError(f"{path}: files of SPSS need pyreadstat: pip install 'hrclog[spss]'") from error
        columns = dict(zip(frame.columns, variable_names(frame.columns), strict=True))
        labels: dict[str, str | None] = {name: _cut(label, _LONGEST_LABEL) for label, name in columns.items()}
        try:
            pyreadstat.write_sav(_plain(frame).rename(columns), path, column_labels=labels, row_compress=True)
        except pyreadstat.ReadstatError as error:
            if str(error) != _NO_SPACE:
                raise
            raise OSError(errno.ENOSPC, "the disk is full, or its quota used up", str(path)) from error


def variable_names(columns: Sequence[str]) -> list[str]:
    """Return a legal name per column: letters, digits and _, beginning with a letter, each once whatever its case."""
    names: list[str] = []
    taken = set(_RESERVED)
    for column in columns:
        stem = _NOT_IN_NAMES.sub("_", column).strip("_") or "v"
        stem = stem if stem[0].isalpha() else f"v_{stem}"
        name, number = _cut(stem, _LONGEST_NAME).rstrip("_"), 1
        while name.upper() in taken:
            number += 1
            end = f"_{number}"
            name = _cut(stem, _LONGEST_NAME - len(end)).rstrip("_") + end
        taken.add(name.upper())
        names.append(name)
    return names


def _cut(text: str, most: int) -> str:
    return text.encode("utf-8", "replace")[:most].decode("utf-8", "ignore")


def _plain(frame: pl.DataFrame) -> pl.DataFrame:
    texts = frame.with_columns(pl.col(pl.List(pl.String)).list.join("|"))
    large = [name for name, kind in texts.schema.items() if kind == pl.Int64 and (texts[name].abs() > _EXACT).any()]
    texts = texts.with_columns(pl.col(large).cast(pl.String))
    text = pl.col(pl.String)
    cut = pl.when(text.str.len_bytes() > _LONGEST_TEXT).then(text.str.slice(0, _LONGEST_TEXT // 4)).otherwise(text)
    return texts.with_columns(cut.name.keep())
