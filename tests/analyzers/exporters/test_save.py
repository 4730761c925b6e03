"""The ending of a file's name tells how a table is written."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import polars as pl
import pytest

import hrclog
from hrclog.errors import HrclogError

FRAME = pl.DataFrame({"=cmd()": ["a"], "n": [1], "list": [["a", "b"]]})


def test_a_table_is_written_by_its_ending(tmp_path: Path) -> None:
    for name in ("new/t.csv", "new/T.PARQUET", "new/t.sav"):
        hrclog.save_table(FRAME, tmp_path / name)
        assert (tmp_path / name).stat().st_size > 0
    assert pl.read_parquet(tmp_path / "new" / "T.PARQUET").equals(FRAME)


def test_names_of_columns_are_no_formulas_of_a_spreadsheet_either(tmp_path: Path) -> None:
    hrclog.save_table(FRAME.with_columns(pl.lit(1).alias("'=cmd()")), tmp_path / "t.csv")
    with (tmp_path / "t.csv").open(newline="") as stream:
        assert next(csv.reader(stream)) == ["''=cmd()", "n", "list", "'=cmd()"]


@pytest.mark.parametrize(
    ("frame", "name", "told"),
    [(FRAME, "t.rds", "found the ending '.rds', expected one of .csv"), (FRAME, "t", "found the ending ''"),
     (FRAME.lazy(), "t.csv", "found LazyFrame, expected a polars DataFrame")],
)  # fmt: skip
def test_what_cannot_be_written_is_one_error(frame: Any, name: str, told: str, tmp_path: Path) -> None:  # noqa: ANN401 - anything
    with pytest.raises(HrclogError, match=told):
        hrclog.save_table(frame, tmp_path / name)
