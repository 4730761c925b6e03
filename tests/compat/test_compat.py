"""What older versions wrote is read with equal results; README.md says what is there."""

from __future__ import annotations

import gzip
import json
import shutil
from io import BytesIO
from pathlib import Path

import polars as pl
import pytest
from polars.testing import assert_frame_equal

import hrclog
from hrclog.knowledge import open_knowledge
from hrclog.log.reader import read_logs
from hrclog.log.recover import recover

HERE = Path(__file__).parent
LOGS = sorted(path for path in HERE.glob("*/*.mcap*") if path.suffix != ".gz" and ".annotations" not in path.name)
LARGEST_BYTES = 300_000
COUNTED_OTHERWISE = {"b4a1ef5"}  # a synergy was of executions that both succeeded; see README.md


def events_of(log: Path) -> pl.DataFrame:
    """Return the events as the version that wrote a log read them."""
    return pl.read_json(BytesIO(gzip.decompress(log.with_name(f"{log.name}.events.json.gz").read_bytes())))


def name_of(path: Path) -> str:
    return str(path.relative_to(HERE))


def same(first: pl.DataFrame, second: pl.DataFrame) -> None:
    """Compare the columns that both have; there are many."""
    names = [name for name in first.columns if name in second.columns]
    assert len(names) >= 0.8 * len(first.columns)
    assert_frame_equal(first.select(names), second.select(names), check_dtypes=False)


@pytest.mark.parametrize("log", LOGS, ids=name_of)
def test_events_are_those_that_the_version_read_that_wrote_them(log: Path, tmp_path: Path) -> None:
    logs = read_logs([log], signals=True)
    assert not [finding.code for finding in logs.diagnostics if finding.severity == "error"]
    same(events_of(log), logs.events)
    assert logs.signals.height >= 4
    if log.suffix == ".partial":
        copied = shutil.copy(log, tmp_path / log.name)
        recovered = read_logs([recover(Path(copied)).path])
        same(events_of(log), recovered.events)
        assert not [finding.code for finding in recovered.diagnostics if finding.severity == "error"]


def test_a_bag_of_the_same_messages_gives_the_same_events() -> None:
    logs = read_logs([HERE / "82ec22b" / "bag"])
    same(events_of(HERE / "82ec22b" / "run.mcap"), logs.events)


@pytest.mark.parametrize("results", sorted(HERE.glob("*/results")), ids=name_of)
def test_an_analysis_gives_the_results_that_it_gave(results: Path) -> None:
    analysis = hrclog.analyze(results.parent / "run.mcap")
    before = json.loads((results / "analysis.json").read_text(encoding="utf-8"))
    assert before["schema_version"] == 1
    for name in ("intervals", "durations"):
        table = pl.read_parquet(results / f"{name}.parquet")
        shown = table.drop("path", strict=False)
        same(shown, getattr(analysis, name).drop("path", strict=False))
    if results.parent.name not in COUNTED_OTHERWISE:
        same(pl.read_parquet(results / "synergies.parquet"), analysis.synergies)


def test_a_folder_of_old_results_is_no_folder_of_logs(tmp_path: Path) -> None:
    shutil.copytree(HERE / "2a79226", tmp_path / "all")
    read = read_logs([tmp_path / "all"])
    assert sorted(path.name for path in read.paths) == ["killed.mcap.partial", "run.mcap"]


@pytest.mark.parametrize("packed", sorted(HERE.glob("*/kb.sqlite.gz")), ids=name_of)
def test_a_knowledge_base_is_read_and_knows_the_run_again(packed: Path, tmp_path: Path) -> None:
    place = tmp_path / "kb.sqlite"
    place.write_bytes(gzip.decompress(packed.read_bytes()))
    with open_knowledge(str(place)) as kb, kb.view() as view:
        runs, results = view.runs(), view.results()
    assert [run.name for run in runs] == ["run"]
    events = events_of(packed.parent / "run.mcap")
    assert results.height == runs[0].n_executions == events.filter(pl.col("kind") == "task_ended").height
    assert set(results["run_id"]) == set(events["run_id"])


def test_the_files_stay_small() -> None:
    assert sum(path.stat().st_size for path in HERE.rglob("*") if path.is_file()) < LARGEST_BYTES
