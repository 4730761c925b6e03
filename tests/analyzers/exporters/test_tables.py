"""CSV files that a spreadsheet can open without running what a log says."""

from __future__ import annotations

import csv
from pathlib import Path

import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hrclog.analyzers.exporters.tables import Csv, Parquet

RUNS = st.sampled_from("=+-@\t\r")
TEXT = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"))
CELLS = st.lists(TEXT | st.builds(str.__add__, RUNS, TEXT), min_size=1)


def cells(path: Path) -> list[str]:
    with path.open(newline="", encoding="utf-8") as stream:
        return [row["text"] for row in csv.DictReader(stream)]


@given(CELLS)
def test_no_text_that_a_spreadsheet_would_run_is_written_as_it_is(tmp_path: Path, texts: list[str]) -> None:
    path = tmp_path / "table.csv"
    Csv().write(pl.DataFrame({"text": texts, "number": [-1.5] * len(texts)}), path)
    for text, written in zip(texts, cells(path), strict=True):
        assert written in (text, f"'{text}")
        if written[:1] in tuple("=+-@\t\r"):
            float(written)
        if text[:1] not in tuple("=+-@\t\r"):
            assert written == text


@pytest.mark.parametrize("text", ["-1", "+1.5", "-.5", "-1e-3", "+2.E5", "-0"])
def test_numbers_are_left_as_they_are(text: str, tmp_path: Path) -> None:
    Csv().write(pl.DataFrame({"text": [text]}), tmp_path / "table.csv")
    assert cells(tmp_path / "table.csv") == [text]


@pytest.mark.parametrize("text", ["-1+1", "=1", "+cmd", "--1", "-", "-1 ", "@SUM(A1:A9)", "-1\n", "\t=1+1"])
def test_what_only_begins_as_a_number_is_made_harmless(text: str, tmp_path: Path) -> None:
    Csv().write(pl.DataFrame({"text": [text]}), tmp_path / "table.csv")
    assert cells(tmp_path / "table.csv") == [f"'{text}"]


def test_lists_are_made_harmless_as_one_text(tmp_path: Path) -> None:
    Csv().write(pl.DataFrame({"text": [["=1+1", "human"], ["human", "=1+1"], []]}), tmp_path / "table.csv")
    assert cells(tmp_path / "table.csv") == ["'=1+1|human", "human|=1+1", ""]


@given(CELLS)
def test_texts_are_kept_where_that_is_wished_and_in_parquet(tmp_path: Path, texts: list[str]) -> None:
    frame = pl.DataFrame({"text": texts})
    Csv(keep_formulas=True).write(frame, tmp_path / "table.csv")
    Parquet().write(frame, tmp_path / "table.parquet")
    assert cells(tmp_path / "table.csv") == texts
    assert pl.read_parquet(tmp_path / "table.parquet")["text"].to_list() == texts
