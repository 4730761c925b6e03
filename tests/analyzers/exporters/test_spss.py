"""Files of SPSS hold what the table holds, under names that SPSS takes."""

from __future__ import annotations

import re
from pathlib import Path

import polars as pl
import pyreadstat
import pytest
from hypothesis import given
from hypothesis import strategies as st

import hrclog
from hrclog.analyzers.exporters.spss import Spss, variable_names
from hrclog.errors import HrclogError, OutputError

ODD = ["a", "A", "all", "to", "1", "a b", "日" * 30, "a" * 63 + "!b"]
NAMES = st.lists(st.text(max_size=70) | st.sampled_from(ODD), unique=True)


@given(NAMES)
def test_names_are_legal_and_told_apart(columns: list[str]) -> None:
    names = variable_names(columns)
    assert len({name.upper() for name in names}) == len(columns)
    for name in names:
        assert re.fullmatch(r"[^\W\d_]\w*", name)
        assert len(name.encode()) <= 64
        assert not name.endswith("_")


@given(st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), min_size=1, max_size=70))
def test_a_column_of_any_name_is_written(tmp_path: Path, column: str) -> None:
    frame = pl.DataFrame({column: [1.5, None], "text": ["=1+1", "é"], "list": [["a", "b"], []], "ok": [True, None]})
    hrclog.save_table(frame, tmp_path / "table.sav")
    back, facts = pyreadstat.read_sav(tmp_path / "table.sav", output_format="polars")
    assert [*back.iter_rows()] == [(1.5, "=1+1", "a|b", 1.0), (None, "é", "", None)]
    assert (facts.column_labels[0] or "").strip() == column.strip()


def test_whole_numbers_that_a_double_does_not_hold_are_texts_and_long_texts_are_cut(tmp_path: Path) -> None:
    frame = pl.DataFrame({"time_ns": [1_772_442_001_000_000_001, None], "n": [1, 2], "long": ["é" * 40_000, ""]})
    hrclog.save_table(frame, tmp_path / "table.sav")
    back, _ = pyreadstat.read_sav(tmp_path / "table.sav", output_format="polars")
    assert back["time_ns"].to_list() == ["1772442001000000001", ""]
    assert back["n"].to_list() == [1.0, 2.0]
    assert 0 < len(back["long"][0].encode()) <= 32_767


def test_a_table_without_rows_is_written(tmp_path: Path) -> None:
    hrclog.save_table(pl.DataFrame(schema={"a": pl.String, "b": pl.Float64}), tmp_path / "table.sav")
    back, _ = pyreadstat.read_sav(tmp_path / "table.sav", output_format="polars")
    assert back.columns == ["a", "b"]


def test_a_place_that_takes_no_file_is_one_error(tmp_path: Path) -> None:
    (tmp_path / "x.sav").mkdir()
    with pytest.raises(OutputError, match="cannot be written"):
        hrclog.save_table(pl.DataFrame({"a": [1]}), tmp_path / "x.sav")


def test_pyreadstat_is_asked_for_where_it_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pyreadstat", None)
    with pytest.raises(HrclogError, match=r"pip install 'hrclog\[spss\]'"):
        Spss().write(pl.DataFrame({"a": [1]}), tmp_path / "x.sav")
