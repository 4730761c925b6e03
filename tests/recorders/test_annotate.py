"""Tags said afterwards: beside the log, which stays as it is; what was said last holds."""

from __future__ import annotations

import gzip
import os
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import polars as pl
import pytest
import zstandard

import hrclog
from hrclog import Recorder
from hrclog.errors import HrclogError, InvalidEventError, LogReadError
from hrclog.log.recover import recover
from hrclog.log.remarks import without_said
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


def test_json_has_tags_by_their_keys_whatever_their_columns_are_called(tmp_path: Path) -> None:
    tags = {"name": "a", "run_id": "b", "tag_run_id": "c", "condition": "d"}
    analysis = hrclog.analyze(record(tmp_path / "a.mcap", tags=tags))
    assert analysis.to_dict()["runs"][0]["tags"] == tags
    assert analysis.runs.row(0, named=True)["tag_run_id"] == "b"


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


@pytest.mark.parametrize("target", ["run", "0.."])
def test_a_run_of_which_something_is_excluded_is_resumed_as_it_is(target: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    recorder = Recorder(path, agents=["robot"])
    execution = recorder.start("robot", "pick").fact.execution_id
    recorder.close()
    hrclog.annotate(path, exclude=[target], reason="a rehearsal")
    with Recorder(path, resume=True) as resumed:
        assert [handle.fact.execution_id for handle in resumed.open_executions()] == [execution]
        next(iter(resumed.open_executions())).end()
    hrclog.annotate(tmp_path, include=[target])
    logs = hrclog.read_logs([tmp_path])
    assert without_said(logs.events)["seq"].to_list() == list(range(6))
    assert not logs.diagnostics


def test_the_last_word_holds_whichever_file_of_a_run_it_was_said_of(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap")
    record(path, resume=True)
    hrclog.annotate(tmp_path, exclude=["run"], reason="a rehearsal")
    assert hrclog.analyze(tmp_path).runs.height == 0
    hrclog.annotate(path, include=["run"])
    analysis = hrclog.analyze(tmp_path)
    assert (analysis.runs["n_executions"].to_list(), analysis.exclusions) == ([2], [])
    hrclog.annotate(tmp_path / "a.2.mcap", exclude=["run"], reason="after all")
    analysis = hrclog.analyze(tmp_path)
    assert (analysis.runs.height, len(analysis.exclusions)) == (0, 1)


def test_they_are_read_whatever_name_led_to_the_log(tmp_path: Path) -> None:
    for folder in ("logs", "links"):
        (tmp_path / folder).mkdir()
    path = record(tmp_path / "logs" / "a.mcap")
    link = tmp_path / "links" / "b.mcap"
    link.symlink_to(path)
    hrclog.annotate(link, {"a": 1})
    assert tags_at(path) == tags_at(tmp_path) == tags_at(link) == [{"a": "1"}]
    (tmp_path / "links" / "b.annotations.mcap").symlink_to(tmp_path / "logs" / "a.annotations.mcap")
    assert not hrclog.read_logs([link]).diagnostics


def test_those_of_a_link_stay_beside_it_where_the_folder_of_its_file_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for folder in ("logs", "links"):
        (tmp_path / folder).mkdir()
    path = record(tmp_path / "logs" / "a.mcap")
    link = tmp_path / "links" / "b.mcap"
    link.symlink_to(path)
    monkeypatch.setattr(os, "access", lambda folder, _: folder != path.parent)
    hrclog.annotate(link, {"a": 1})
    assert [place.name for place in link.parent.iterdir() if place != link] == ["b.annotations.mcap"]
    assert (tags_at(link), tags_at(path)) == ([{"a": "1"}], [])


def test_those_of_a_bag_are_read_from_within_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = tmp_path / "bag"
    (bag / "below").mkdir(parents=True)
    record(bag / "bag_0.mcap")
    (bag / "metadata.yaml").write_text("rosbag2_bagfile_information: {relative_file_paths: [bag_0.mcap]}\n")
    for place, name in ((bag, "."), (bag / "below", "..")):
        monkeypatch.chdir(place)
        hrclog.annotate(name, {name.replace(".", "i"): 1})
    assert tags_at(bag) == [{"i": "1", "ii": "1"}]


@pytest.mark.parametrize("ending", [".gz", ".zst"])
def test_they_are_read_when_all_files_were_compressed(ending: str, tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap")
    hrclog.annotate(path, {"a": 1})
    pack = gzip.compress if ending == ".gz" else zstandard.compress
    for file in tmp_path.glob("*.mcap"):
        file.with_name(file.name + ending).write_bytes(pack(file.read_bytes()))
        file.unlink()
    packed = tmp_path / f"a.mcap{ending}"
    assert tags_at(packed) == tags_at(tmp_path) == [{"a": "1"}]
    hrclog.annotate(packed, {"a": 2})
    assert tags_at(packed) == [{"a": "2"}]


def test_those_of_a_run_that_the_log_does_not_hold_are_told(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap")
    hrclog.annotate(path, exclude=["run"], reason="a rehearsal")
    path.unlink()
    logs = hrclog.read_logs([record(path)])
    assert [(finding.code, finding.path) for finding in logs.diagnostics] == [
        ("annotation_unmatched", str(tmp_path / "a.annotations.mcap"))
    ]


def test_those_without_their_log_are_told(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap")
    hrclog.annotate(path, {"a": 1})
    path.rename(tmp_path / "b.mcap")
    lone = tmp_path / "a.annotations.mcap"
    findings = hrclog.read_logs([tmp_path]).diagnostics
    assert [(finding.code, finding.path) for finding in findings] == [("annotation_unmatched", str(lone))]
    lone.rename(tmp_path / "b.annotations.mcap")
    assert (hrclog.read_logs([tmp_path]).diagnostics, tags_at(tmp_path)) == ([], [{"a": "1"}])


def test_they_go_with_a_log_that_is_recovered_under_another_name(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap")
    hrclog.annotate(path, {"a": 1})
    damaged = path.read_bytes()[:-40]
    path.write_bytes(damaged)
    recover(path)
    assert tags_at(tmp_path / "a.recovered.mcap") == [{"a": "1"}]
    path.rename(tmp_path / "a.mcap.partial")
    (tmp_path / "elsewhere").mkdir()
    recover(tmp_path / "a.mcap.partial", tmp_path / "elsewhere" / "b.mcap")
    assert tags_at(tmp_path / "elsewhere") == [{"a": "1"}]


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
