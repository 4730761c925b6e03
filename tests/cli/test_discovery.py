"""Commands find logs at any depth; what they pass over they tell."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol

import polars as pl
import pytest

from hrclog.analyzers.output import JSON_NAME
from hrclog.log.files.discover import discover, find_logs
from hrclog.log.files.search import RESULTS_FILE
from hrclog.log.reader import read_logs

Run = Callable[..., Any]


class Analyzed(Protocol):
    """The sample campaign analysed; conftest.py holds the class."""

    folder: Path


def put(path: Path, content: bytes = b"") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


def names(root: Path, *arguments: Path) -> list[str]:
    return [str(path.relative_to(root)) for path in find_logs(arguments or [root])]


def test_a_link_to_nothing_is_told(run: Run, samples: Path, tmp_path: Path) -> None:
    shutil.copy(samples / "single.mcap", tmp_path / "a.mcap")
    (tmp_path / "gone.mcap").symlink_to("nowhere/annexed")
    (tmp_path / "gone.txt").symlink_to("nowhere")
    result = run("info", tmp_path)
    assert result.code == 3
    assert "gone.mcap: found a link to nowhere/annexed, which is not there" in result.err
    assert "gone.txt" not in result.err


def test_results_are_passed_over_with_a_word_and_read_when_they_are_named(
    run: Run, analyzed: Analyzed, samples: Path, tmp_path: Path
) -> None:
    assert RESULTS_FILE == JSON_NAME
    logs = tmp_path / "logs"
    shutil.copytree(samples / "campaign", logs)
    shutil.copytree(analyzed.folder, logs / "out")
    put(logs / "other" / RESULTS_FILE, b"{}")
    shutil.copy(samples / "single.mcap", logs / "other")
    shutil.copy(samples / "failures.mcap", logs / "out" / "runs")
    found = discover([logs])
    assert len(found.logs) == 13
    assert [(path.name, text) for path, text in found.unread] == [
        ("out", "1 log in this folder of results was not read; name the folder too")
    ]
    assert names(logs, logs / "out") == ["out/runs/failures.mcap"]
    both = discover([logs, logs / "out" / "runs"])
    assert (len(both.logs), both.unread) == (14, [])
    only = run("check", tmp_path / "logs" / "out")
    assert only.code == 0
    (tmp_path / "only").mkdir()
    (logs / "out").rename(tmp_path / "only" / "out")
    result = run("check", tmp_path / "only")
    assert (result.code, "1 log in this folder of results" in result.err) == (1, True)


def test_a_folder_that_cannot_be_opened_is_told_and_hides_nothing(
    run: Run, samples: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(samples / "campaign", tmp_path / "logs" / "a")
    put(tmp_path / "logs" / "locked" / "r.mcap")
    scandir = os.scandir

    def refuse(path: Path) -> Iterator[os.DirEntry[str]]:
        if Path(path).name == "locked":
            raise PermissionError(13, "Permission denied", str(path))
        return scandir(path)

    monkeypatch.setattr(os, "scandir", refuse)
    result = run("check", tmp_path / "logs")
    assert result.code == 3
    assert "12 runs" in result.out
    assert f"{tmp_path / 'logs' / 'locked'}: found a folder that cannot be opened (Permission denied)" in result.err
    alone = run("check", tmp_path / "logs" / "locked")
    assert (alone.code, "cannot be opened" in alone.err) == (1, True)


def test_a_recording_of_another_system_beside_logs_is_a_note(run: Run, samples: Path, tmp_path: Path) -> None:
    result = run("check", samples, "--json")
    codes = {row["code"] for row in result.json()["diagnostics"] if "tuesday" in row["path"]}
    assert "not_imported" in codes
    assert "no_events" not in codes
    shutil.copytree(samples / "ros2_actions" / "tuesday", tmp_path / "logs" / "tuesday")
    shutil.copy(samples / "single.mcap", tmp_path / "logs")
    done = run("export", tmp_path / "logs", "-o", tmp_path / "out", "--table", "runs")
    assert (done.code, "[not_imported]" in done.err) == (0, True)
    named = run("check", tmp_path / "logs", tmp_path / "logs" / "tuesday")
    alone = run("check", tmp_path / "logs" / "tuesday")
    folder = run("check", samples / "ros2_actions")
    assert [done.code for done in (named, alone, folder)] == [3, 3, 3]
    assert all("[no_events]" in done.err for done in (named, alone, folder))


def test_journals_are_recovered_at_any_depth(run: Run, samples: Path, tmp_path: Path) -> None:
    for place in ("a/b", "bag"):
        (tmp_path / place).mkdir(parents=True)
        shutil.copy(samples / "killed.mcap.partial", tmp_path / place)
    put(tmp_path / "bag" / "metadata.yaml")
    put(tmp_path / "lost" / "metadata.yaml", b"rosbag2_bagfile_information:")
    assert run("recover", tmp_path).code == 3
    assert (tmp_path / "a" / "b" / "killed.mcap").is_file()
    assert (tmp_path / "bag" / "killed.mcap").is_file()


def test_a_folder_gives_what_its_logs_give_one_by_one(samples: Path) -> None:
    logs = find_logs([samples / "campaign", samples / "ros2_actions"])
    assert (
        read_logs([samples])
        .events.filter(pl.col("path") == str(logs[3]))
        .equals(read_logs([logs[3]]).events.select(read_logs([logs[3]]).events.columns))
    )
