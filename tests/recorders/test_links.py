"""A path that is a symbolic link is the file that it points to."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from hrclog.errors import LogExistsError, LogReadError, LogWriteError
from hrclog.log.reader import read_logs
from hrclog.recorders.recorder import Recorder, log_path
from hrclog.recorders.stdin import record_stream

pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs symbolic links")
STARTED = json.dumps({"kind": "task_started", "agent": "robot", "task": "pick"})
ENDED = json.dumps({"kind": "task_ended", "agent": "robot", "task": "pick"})


@pytest.fixture(params=["other/real.mcap", "real.mcap", "not/there/real.mcap"])
def link(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    """Return a link to a file that is not there."""
    (tmp_path / "other").mkdir()
    link = tmp_path / "link.mcap"
    link.symlink_to(request.param)
    return link


def files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file() and not path.is_symlink()}


def test_log_journal_segments_and_further_runs_lie_where_the_link_points_to(link: Path, tmp_path: Path) -> None:
    real = link.readlink()
    recording = record_stream([STARTED, json.dumps({"kind": "run_started", "name": "next"}), STARTED], link)
    assert [run.path.name for run in recording.runs] == ["real.mcap", "real-run2.mcap"]
    with pytest.raises(LogExistsError):
        record_stream([], link)
    with Recorder(link, resume=True) as recorder:
        during = files(tmp_path)
        assert [handle.fact.task for handle in recorder.open_executions()] == ["pick"]
    places = {real, real.with_name("real-run2.mcap"), real.with_name("real.2.mcap")}
    assert during == {str(place) for place in places if place.name != "real.2.mcap"} | {
        str(real.with_name("real.2.mcap.partial"))
    }
    assert files(tmp_path) == {str(place) for place in places}
    assert link.is_symlink()
    assert read_logs([link]).events["kind"].to_list() == ["run_started", "task_started", "run_ended"]


def test_a_run_whose_recorder_was_killed_is_resumed_through_the_link(tmp_path: Path) -> None:
    link, real = tmp_path / "link.mcap", tmp_path / "folder" / "real.mcap"
    real.parent.mkdir()
    link.symlink_to(real)
    recorder = Recorder(link)
    recorder.start("robot", "pick")
    with pytest.raises(LogReadError, match="still writes"):
        Recorder(real, resume=True)
    recorder.renew_after_fork()  # lets go of the journal, as a kill does
    [run] = record_stream([ENDED], link, resume=True).runs
    assert run.path == real.with_name("real.2.mcap")
    assert files(tmp_path) == {"folder/real.mcap", "folder/real.2.mcap"}


def test_a_link_without_an_ending_to_a_log_is_that_log(tmp_path: Path) -> None:
    (tmp_path / "latest").symlink_to(tmp_path / "real.mcap")
    (tmp_path / "folder").mkdir()
    (tmp_path / "out").symlink_to(tmp_path / "folder")
    assert log_path(tmp_path / "latest") == tmp_path / "real.mcap"
    assert log_path(tmp_path / "out") == tmp_path / "out.mcap"
    assert log_path("x" * 5000) == Path("x" * 5000 + ".mcap")


@pytest.mark.parametrize(("target", "reason"), [("link.mcap", "in a circle"), ("other.bin", "a symbolic link to")])
def test_a_link_to_no_log_is_refused_and_stays(target: str, reason: str, tmp_path: Path) -> None:
    link = tmp_path / "link.mcap"
    link.symlink_to(target)
    with pytest.raises(LogWriteError, match=reason):
        record_stream([STARTED], link)
    assert link.readlink() == Path(target)
    assert files(tmp_path) == set()
