"""Frames in memory are read as their files are, and analysed without a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import polars as pl
import pytest
from polars.testing import assert_frame_equal

import hrclog
from hrclog.errors import HrclogError
from hrclog.recorders.importers.table.importer import TableImporter
from hrclog.recorders.importers.writing import import_files

FACTS = pl.DataFrame(
    {
        "trial": ["a", "a", "b", "b"],
        "who": ["robot", "human", "robot", "human"],
        "step": ["pick", "screw", "pick", "screw"],
        "start": [1_772_442_000.5, 1_772_442_001.0, 1_772_442_100.0, 1_772_442_101.25],
        "end": [1_772_442_004.5, 1_772_442_006.0, 1_772_442_105.0, None],
    }
)
OPTIONS: dict[str, Any] = {"agent": "who", "task": "step", "run": "trial"}


@pytest.mark.parametrize("library", ["polars", "lazy", "pyarrow", "dict", "pandas"])
def test_a_frame_of_any_library_is_read_as_its_file_is(library: str, tmp_path: Path) -> None:
    FACTS.write_csv(tmp_path / "t.csv")
    import_files(TableImporter(), [tmp_path / "t.csv"], tmp_path / "file", **OPTIONS | {"run": ("trial",)})
    frame = {
        "polars": lambda: FACTS,
        "lazy": FACTS.lazy,
        "pandas": FACTS.to_pandas,
        "pyarrow": FACTS.to_arrow,
        "dict": FACTS.to_dict,
    }[library]()
    runs = hrclog.from_table(frame, **OPTIONS)
    assert_frame_equal(runs.events.drop("path"), hrclog.read_events(tmp_path / "file").drop("path"))
    written = hrclog.write_logs(runs, tmp_path / "frame")
    assert [path.name for path in written] == ["a.mcap", "b.mcap"]
    for path in written:
        assert path.read_bytes() == (tmp_path / "file" / path.name).read_bytes()
    assert hrclog.write_logs(runs, tmp_path / "frame") == written


def test_a_frame_is_analysed_without_a_file() -> None:
    analysis = hrclog.analyze(hrclog.from_table(FACTS, **OPTIONS, tags={"lab": "north"}))
    assert analysis.durations.select("agent", "count").rows() == [("human", 1), ("robot", 2)]
    assert analysis.runs["name"].to_list() == ["a", "b"]


@pytest.mark.parametrize(
    ("frame", "options", "told"),
    [(7, {}, "no table"), (FACTS, {"agnt": "who"}, "agent"), (FACTS, {"agent": "whom"}, "did you mean 'who'"),
     (FACTS, {"unit": "h"}, "days"), (FACTS, {"agent": 5}, "agent is 5"), (FACTS, {"tags": ["a=1"]}, "tags are")],
)  # fmt: skip
def test_what_is_no_table_is_one_error(frame: Any, options: dict[str, Any], told: str) -> None:  # noqa: ANN401 - anything
    with pytest.raises(HrclogError, match=told):
        hrclog.from_table(frame, **options)
