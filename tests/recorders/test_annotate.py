"""Tags said afterwards: beside the log, which stays as it is; what was said last holds."""

from __future__ import annotations

import gzip
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import polars as pl
import pytest

import hrclog
from hrclog import Recorder
from hrclog.errors import HrclogError, InvalidEventError, LogReadError
from hrclog.log.recover import recover
from hrclog.log.runs.tags import run_tags


def record(path: Path, **facts: object) -> Path:
    with Recorder(path, agents=["robot"], **facts) as recorder, recorder.task("robot", "pick"):  # type: ignore[arg-type]  # facts of a run
        pass
    return path


def tags_at(*paths: Path) -> list[dict[str, str]]:
    return list(run_tags(hrclog.read_events(paths)).values())


def test_a_tag_is_read_with_the_log_which_stays_as_it_is(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap", tags={"participant": "P01", "trial": 3})
    before, plain = path.read_bytes(), hrclog.analyze(path)
    hrclog.annotate(path, {"condition": "pilot", "trial": 4})
    assert path.read_bytes() == before
    assert tags_at(path) == [{"condition": "pilot", "participant": "P01", "trial": "4"}]
    after = hrclog.analyze(tmp_path)
    for name in ("intervals", "durations", "synergies", "overlaps", "metrics"):
        assert getattr(after, name).equals(getattr(plain, name)), name
    assert after.runs.drop("condition", "participant", "trial").equals(plain.runs.drop("participant", "trial"))
    assert [finding.code for finding in after.diagnostics] == [finding.code for finding in plain.diagnostics]


def test_what_was_said_last_holds_and_may_be_taken_back(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap", tags={"trial": 1})
    for tags in ({"a": "1"}, {"a": "2", "b": "1"}, {"b": None, "trial": None}):
        hrclog.annotate(path, tags)
    assert tags_at(path) == [{"a": "2"}]


def test_it_goes_with_the_log_through_its_states(tmp_path: Path) -> None:
    journal = tmp_path / "a.mcap.partial"
    with Recorder(tmp_path / "a.mcap") as recorder, recorder.task("robot", "pick"):
        hrclog.annotate(journal, {"a": 1})
        shutil.copy(journal, tmp_path / "copy")
    assert tags_at(tmp_path / "a.mcap") == [{"a": "1"}]
    (tmp_path / "a.mcap").unlink()
    shutil.move(tmp_path / "copy", journal)
    assert tags_at(journal) == [{"a": "1"}]
    recover(journal)
    assert tags_at(tmp_path / "a.mcap") == [{"a": "1"}]
    packed = tmp_path / "a.mcap.gz"
    packed.write_bytes(gzip.compress((tmp_path / "a.mcap").read_bytes()))
    (tmp_path / "a.mcap").unlink()
    assert tags_at(packed) == [{"a": "1"}]


def test_a_run_that_is_resumed_keeps_its_tags_and_its_numbers(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap")
    hrclog.annotate(path, {"a": 1})
    record(path, resume=True, tags={"b": 2})
    hrclog.annotate(tmp_path, {"c": 3})
    logs = hrclog.read_logs([tmp_path])
    assert run_tags(logs.events) == {logs.events["run_id"][0]: {"a": "1", "b": "2", "c": "3"}}
    assert not [finding for finding in logs.diagnostics if finding.severity == "error"]


def test_runs_are_chosen_by_name_and_by_tags(tmp_path: Path) -> None:
    for number in range(4):
        record(tmp_path / f"{number}.mcap", run=f"run {number}", tags={"half": number // 2})
    done = hrclog.annotate(tmp_path, {"chosen": "yes"}, runs=["run 2"], where="half=1")
    assert (list(done.runs.values()), [path.name for path in done.written]) == (["run 2"], ["2.annotations.mcap"])
    table = hrclog.analyze(tmp_path, where={"chosen": "yes"}).runs
    assert table["name"].to_list() == ["run 2"]
    with pytest.raises(HrclogError, match=r"run 'run 9': found no such run, expected one of 'run 0', 'run 1'"):
        hrclog.annotate(tmp_path, {"chosen": "yes"}, runs=["run 9"])
    with pytest.raises(InvalidEventError, match="nothing to say"):
        hrclog.annotate(tmp_path, {})


def test_of_those_who_say_something_at_once_none_is_lost(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap")
    with ThreadPoolExecutor(4) as threads:
        list(threads.map(lambda number: hrclog.annotate(path, {f"k{number}": number}), range(12)))
    assert tags_at(path) == [{f"k{number}": str(number) for number in sorted(range(12), key=str)}]


def test_annotations_that_are_damaged_cost_no_log_and_are_not_overwritten(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap")
    hrclog.annotate(path, {"a": 1})
    beside = tmp_path / "a.annotations.mcap"
    beside.write_bytes(beside.read_bytes()[:200])
    logs = hrclog.read_logs([path])
    assert logs.events.height == hrclog.read_logs([record(tmp_path / "b.mcap")]).events.height
    assert {finding.path for finding in logs.diagnostics if finding.severity == "error"} == {str(beside)}
    with pytest.raises(LogReadError, match=r"a\.annotations\.mcap: found damage"):
        hrclog.annotate(path, {"a": 2})
    beside.write_bytes(b"no log at all")
    assert [f.code for f in hrclog.read_logs([path]).diagnostics if f.path == str(beside)] == ["unreadable_file"]


def test_a_glob_of_all_files_reads_each_run_once(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap")
    hrclog.annotate(path, {"a": 1})
    assert len(list(tmp_path.glob("*.mcap"))) == 2
    logs = hrclog.read_logs(sorted(tmp_path.glob("*.mcap")))
    assert (logs.paths, [finding.code for finding in logs.diagnostics]) == ([path], [])


def test_a_knowledge_base_takes_an_annotated_run_for_the_same(tmp_path: Path) -> None:
    from hrclog.analyzers.learning.ingest import ingest_logs

    path = record(tmp_path / "a.mcap")
    with hrclog.open_knowledge(str(tmp_path / "kb.sqlite"), create=True) as kb:
        assert len(ingest_logs(kb, [path]).added) == 1
        hrclog.annotate(path, {"a": 1})
        assert len(ingest_logs(kb, [path]).unchanged) == 1


@pytest.mark.parametrize("whole", [True, False])
def test_a_run_of_which_something_is_excluded_can_be_resumed(whole: bool, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with Recorder(path, agents=["robot"]) as recorder:
        open_one = recorder.start("robot", "pick")
    hrclog.annotate(path, exclude=["run" if whole else open_one.execution_id], reason="a mistaken entry")
    with Recorder(path, resume=True) as recorder:
        recorder.end(open_one.execution_id)
    hrclog.annotate(tmp_path, include=["run" if whole else open_one.execution_id])
    events = hrclog.read_events(tmp_path).filter(pl.col("kind") != "annotation_added")
    kinds = ["run_started", "task_started", "run_ended", "run_started", "task_ended", "run_ended"]
    assert events.sort("seq")["kind"].to_list() == kinds
    assert events["seq"].is_unique().all()
