"""Frames as files: what polars cannot write is an OSError that names the file."""

from __future__ import annotations

import os
from pathlib import Path

import polars as pl
import pytest
from full_disks import largest_file
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.frame_files import write_by

pytestmark = pytest.mark.skipif(os.name != "posix", reason="limits the size of files as POSIX does")

FRAME = pl.DataFrame({"a": range(2000), "b": [f"text {number}" for number in range(2000)]})


@pytest.mark.parametrize("how", ["write_parquet", "write_csv"])
def test_the_bytes_are_those_that_polars_writes(how: str, tmp_path: Path) -> None:
    getattr(FRAME, how)(tmp_path / "a")
    write_by(getattr(FRAME, how), tmp_path / "b")
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


@settings(max_examples=30)
@given(st.sampled_from(["write_parquet", "write_csv"]), st.integers(0, 8000))
def test_a_full_disk_is_told_as_such(tmp_path: Path, how: str, size: int) -> None:
    with largest_file(size), pytest.raises(OSError, match="File too large") as caught:
        write_by(getattr(FRAME, how), tmp_path / "a")
    assert caught.value.filename == str(tmp_path / "a")


def test_another_error_of_polars_stays(tmp_path: Path) -> None:
    with pytest.raises(pl.exceptions.ComputeError):
        write_by(pl.DataFrame({"a": [[1]]}).write_csv, tmp_path / "a")
