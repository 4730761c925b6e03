"""What pandas and others have of their own way of keeping a table means what the same table means in polars."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from typing import Any, Final

import duckdb
import narwhals as nw
import numpy as np
import pandas as pd
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st
from polars.testing import assert_frame_equal

import hrclog
from hrclog.errors import HrclogError
from hrclog.recorders.importers.table.frames import as_polars

ROME: Final = pd.Timestamp("2026-03-02T09:00:00", tz="Europe/Rome")
SECONDS: Final = ([0.0, 1.0, 100.0, 102.0], [4.0, 6.0, 105.0, None])
"""Starts and ends; the last execution is still open."""
OPTIONS: Final[dict[str, Any]] = {"agent": "who", "task": "step", "run": "trial"}


def after(seconds: list[float | None]) -> list[pd.Timestamp]:
    return [pd.NaT if each is None else ROME + pd.Timedelta(seconds=each) for each in seconds]


@pytest.fixture
def study() -> pd.DataFrame:
    """Return a table with zones, missing ends and missing outcomes, as pandas reads it."""
    facts = {"trial": ["a", "a", "b", "b"], "who": ["robot", "human"] * 2, "step": ["pick", "screw"] * 2}
    result = ["succeeded", "failed", None, None]
    return pd.DataFrame({**facts, "start": after(SECONDS[0]), "end": after(SECONDS[1]), "result": result})


def facts_of(frame: Any, **options: Any) -> pl.DataFrame:  # noqa: ANN401 - a frame of any library
    intervals = hrclog.analyze(hrclog.from_table(frame, **OPTIONS | options)).intervals
    return intervals.select("run_id", "agent", "task", "start_ns", "end_ns", "outcome")


FORMS: Final[dict[str, Callable[[pd.DataFrame], Any]]] = {
    "nanoseconds": lambda f: f.assign(start=f.start.dt.as_unit("ns"), end=f.end.dt.as_unit("ns")),
    "seconds": lambda f: f.assign(start=f.start.dt.as_unit("s")),
    "two zones": lambda f: f.assign(start=f.start.dt.tz_convert("UTC"), end=f.end.dt.tz_convert("+05:30")),
    "objects of instants": lambda f: f.assign(start=f.start.astype(object), end=f.end.astype(object)),
    "python's instants": lambda f: f.assign(start=pd.Series([t.to_pydatetime() for t in f.start], dtype=object)),
    "texts": lambda f: f.assign(start=f.start.astype(str), end=f.end.astype(str).replace("NaT", None)),
    "nullable types": lambda f: f.convert_dtypes(dtype_backend="numpy_nullable"),
    "types of arrow": lambda f: f.convert_dtypes(dtype_backend="pyarrow"),
    "categories": lambda f: f.astype({"trial": "category", "who": "category", "step": "category"}),
    "run in the index": lambda f: f.set_index("trial"),
    "run and start in the index": lambda f: f.set_index(["trial", "start"]),
    "other order of rows": lambda f: f.iloc[[0, 2, 1, 3]].sort_index(),
    "columns of no use": lambda f: f.assign(
        p=pd.period_range("2026", periods=4), i=pd.interval_range(0, 4), c=[1j] * 4, o=[object()] * 4, big=[2**70] * 4
    ),
    "arrow": lambda f: pl.from_pandas(f).to_arrow(),
    "batch of arrow": lambda f: pl.from_pandas(f).to_arrow().to_batches()[0],
    "lazy": lambda f: pl.from_pandas(f).lazy(),
    "narwhals": nw.from_native,
    "narwhals, lazy": lambda f: nw.from_native(pl.from_pandas(f).lazy()),
}
"""The same study, kept in other ways."""


@pytest.mark.parametrize("form", FORMS)
def test_the_form_of_a_frame_says_nothing(form: str, study: pd.DataFrame) -> None:
    expected = facts_of(pl.from_pandas(study))
    assert expected["end_ns"].null_count() == 1
    assert_frame_equal(facts_of(FORMS[form](study)), expected)


def test_a_relation_of_duckdb_is_a_table(study: pd.DataFrame) -> None:
    with duckdb.connect() as connection:
        connection.register("study", pl.from_pandas(study).to_arrow())
        assert_frame_equal(facts_of(connection.sql("SELECT * FROM study")), facts_of(study))


def test_differences_of_times_count_from_the_start_of_the_run(study: pd.DataFrame) -> None:
    since = study.assign(start=study.start - ROME, end=study.end - ROME)
    assert_frame_equal(facts_of(since, run_start="2026-03-02T08:00:00Z"), facts_of(study))
    length = study.drop(columns="end").assign(took=study.end - study.start)
    assert_frame_equal(facts_of(length, duration="took"), facts_of(study))


@pytest.mark.parametrize("dtype", ["float64", "Float64", "object", "Sparse[float]"])
def test_numbers_that_are_not_there_are_no_ends(dtype: str, study: pd.DataFrame) -> None:
    start, end = (pd.Series(seconds, dtype="float64").astype(dtype) for seconds in SECONDS)
    assert_frame_equal(facts_of(study.assign(start=start, end=end), run_start="2026-03-02T08:00:00Z"), facts_of(study))


@pytest.mark.parametrize("names", [["1", "1", "2", "2"], [1, 1, 2, 2], [1.0, 1.0, 2.0, 2.0], [1, "1", 2.0, "2"]])
def test_a_run_has_the_same_name_whatever_type_pandas_made_of_it(names: list[object], study: pd.DataFrame) -> None:
    if 2.0 in names and "1" in names:
        names = [int(str(name)[0]) if isinstance(name, float) else name for name in names]
    runs = hrclog.from_table(study.assign(trial=names), **OPTIONS)
    assert_frame_equal(runs.events, hrclog.from_table(study.assign(trial=["1", "1", "2", "2"]), **OPTIONS).events)


def test_instants_with_and_without_a_zone_are_told_apart(study: pd.DataFrame) -> None:
    mixed = [each.tz_localize(None) if number else each for number, each in enumerate(study.start)]
    runs = hrclog.from_table(study.assign(start=pd.Series(mixed, dtype=object)), **OPTIONS)
    [skipped] = [each.message for each in runs.diagnostics if each.code == "skipped_row"]
    assert "no zone" in skipped
    assert "3 rows" in skipped


def test_whole_nanoseconds_are_kept_beside_ends_that_are_not_there(study: pd.DataFrame) -> None:
    start, end = 1_772_442_001_000_000_001, 1_772_442_002_000_000_003
    study["start"], study["end"] = pd.Series([start] * 4, dtype=object), pd.Series([end, np.nan] * 2, dtype=object)
    assert set(facts_of(study).select("start_ns", "end_ns").rows()) == {(start, end), (start, None)}


def test_numbers_of_several_types_are_read_as_exactly_as_they_are_written() -> None:
    cells = [0.5, 2**53 + 1]
    frame = as_polars(pd.DataFrame({"a": pd.Series(cells, dtype=object)}))
    assert frame["a"].to_list() == [str(cell) for cell in cells]


def test_columns_of_several_levels_are_joined_and_ids_are_texts() -> None:
    frame = pd.DataFrame({("time", "start"): [0.0], ("time", "end"): [1.0], ("who", ""): ["r"], ("step", ""): ["x"]})
    frame[("trial", "")] = pd.Series([uuid.UUID(int=1)], dtype=object)
    runs = hrclog.from_table(frame, **OPTIONS, start="time_start", end="time_end")
    assert hrclog.analyze(runs).runs["name"].to_list() == [str(uuid.UUID(int=1))]


def test_an_index_without_a_name_is_index_unless_it_numbers_the_rows(study: pd.DataFrame) -> None:
    assert as_polars(study[study.trial == "b"]).columns == list(study.columns)
    indexed = study.set_index("start").rename_axis(None)
    assert_frame_equal(facts_of(indexed, start="index"), facts_of(study))


@pytest.mark.parametrize("cells", [[["x", "y"]], [np.array(["x", "y"])]])
def test_lists_of_a_cell_are_rows(cells: list[object]) -> None:
    frame = pd.DataFrame({"who": ["r"], "step": cells, "start": [[0.0, 1.0]], "end": [[1.0, 2.0]], "trial": ["t"]})
    assert facts_of(frame)["task"].to_list() == ["x", "y"]


@given(st.lists(st.one_of(st.none(), st.integers(), st.floats(), st.text(), st.binary(max_size=3), st.booleans())))
def test_a_column_of_anything_becomes_a_column(cells: list[object]) -> None:
    frame = as_polars(pd.DataFrame({"a": pd.Series(cells, dtype=object)}))
    assert frame.height == len(cells)
    texts = [cell for cell in cells if isinstance(cell, str)]
    if texts == cells:
        assert frame["a"].to_list() == texts


@pytest.mark.parametrize(
    ("frame", "told"),
    [
        (pd.Series([1]), "found Series that is no table"),
        (pd.DataFrame([[1, 2]], columns=["a", "a"]), "Expected unique column names"),
        (pl.LazyFrame({"a": [1]}).select("b"), 'unable to find column "b"'),
        (pl.DataFrame({"who": pl.Series([object()], dtype=pl.Object), "step": ["x"], "start": [0.0], "end": [1.0]}),
         "found a column that cannot be read"),
        (pd.DataFrame(), "no row"),
        (None, "found NoneType"),
        ("study.csv", "found str"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_one_error(frame: Any, told: str) -> None:  # noqa: ANN401 - anything
    with pytest.raises(HrclogError, match=told):
        hrclog.from_table(frame, agent="who", task="step")
