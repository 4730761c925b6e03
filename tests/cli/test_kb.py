"""`hrclog kb`, and --on-run-end of the verbs that make runs."""

from __future__ import annotations

import io
import json
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from kb_runs import run_of, state_at

from hrclog.log.reader import read_events
from hrclog.log.writing.writer import write_log
from hrclog.planning.plan import write_plan
from hrclog.sim.run import plan_of
from hrclog.sim.scenario import load_scenario

Run = Callable[..., Any]

pytestmark = pytest.mark.slow


@pytest.fixture
def kb(tmp_path: Path) -> Path:
    return tmp_path / "kb.sqlite"


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    """Return a folder with the logs of three runs."""
    folder = tmp_path / "logs"
    folder.mkdir()
    for number in range(3):
        write_log(folder / f"n{number}.mcap", run_of(number))
    return folder


def test_runs_are_taken_in_and_statistics_made(run: Run, kb: Path, logs: Path) -> None:
    first = run("kb", "ingest", logs / "n0.mcap", "--kb", kb, "--json").json()
    assert (first["added"], first["replaced"], first["unchanged"]) == (["run-0000"], [], [])
    shown = run("kb", "show", "--kb", kb, "--json").json()
    assert (shown["statistics"], shown["missing_runs"], shown["durations"]) == (None, 1, [])
    found = run("kb", "update", logs, "--kb", kb, "--json").json()
    assert (found["added"], found["unchanged"], found["updated"]) == (["run-0001", "run-0002"], ["run-0000"], True)
    assert found["statistics"]["runs"] == ["run-0000", "run-0001", "run-0002"]
    assert run("kb", "update", "--kb", kb).out == "statistics are up to date\n"
    shown = run("kb", "show", "--kb", kb, "--json").json()
    assert (shown["missing_runs"], shown["statistics"]["estimator"], len(shown["durations"])) == (0, "aft", 4)
    assert {task["task"]: task["expected_s"] for task in shown["properties"]}["put"] == {"robot": 5.5}


def test_show_says_what_statistics_are_made_from(run: Run, kb: Path, logs: Path) -> None:
    run("kb", "update", logs, "--kb", kb, "--estimator", "ols", "--outliers", "isolation-forest")
    run("kb", "withdraw", "n1", "--reason", "loose\x1b gripper", "--kb", kb)
    write_log(logs / "n3.mcap", run_of(3))
    run("kb", "ingest", logs, "--kb", kb)
    out = run("kb", "show", "--kb", kb).out
    assert "withdrawn: loose\\x1b gripper" in out
    assert "statistics of 2 runs, estimator ols 2, outliers left out by isolation-forest; behind by 1: " in out
    assert "robot put" in out
    assert "guess s" in out
    assert "5.50" in out


def test_a_withdrawn_run_comes_back(run: Run, kb: Path, logs: Path) -> None:
    run("kb", "update", logs, "--kb", kb)
    before = state_at(kb)
    assert run("kb", "withdraw", "n1", "--kb", kb).out == "n1 is withdrawn; statistics updated\n"
    assert run("kb", "rebuild", logs, "--kb", kb).out == "made anew from 3 runs\n"
    assert len(run("kb", "show", "--kb", kb, "--json").json()["statistics"]["runs"]) == 2
    found = run("kb", "withdraw", "run-0001", "--undo", "--kb", kb, "--json").json()
    assert found == {"run_id": "run-0001", "withdrawn": False, "updated": True}
    assert state_at(kb) == before


def test_a_rebuild_from_logs_that_cannot_all_be_read_loses_no_run(run: Run, logs: Path, tmp_path: Path) -> None:
    kb = tmp_path / "kb.sqlite"
    assert run("kb", "update", logs, "--kb", kb).code == 0
    before = run("kb", "show", "--kb", kb, "--json").out
    (tmp_path / "text.mcap").write_text("no log")
    first = min(logs.glob("*.mcap"))
    result = run("kb", "rebuild", first, tmp_path / "text.mcap", "--kb", kb)
    assert result.code == 1
    assert "nothing was changed" in result.err
    assert run("kb", "show", "--kb", kb, "--json").out == before


def test_export_and_import_are_inverse(run: Run, kb: Path, logs: Path, tmp_path: Path) -> None:
    run("kb", "update", logs, "--kb", kb, "--estimator", "paper")
    written = run("kb", "export", "--kb", kb, "-o", tmp_path / "out", "--json").json()["written"]
    assert {Path(row["path"]).name: row["rows"] for row in written}["task_results.json"] == 12
    assert run("kb", "import", tmp_path / "out", "--kb", tmp_path / "copy").code == 0
    assert state_at(tmp_path / "copy") == state_at(kb)
    assert run("kb", "export", "--kb", kb, "-o", tmp_path / "frames", "--format", "parquet").code == 0
    assert run("kb", "import", tmp_path / "frames", "--kb", tmp_path / "copy").code == 1


def test_one_bad_log_does_not_hide_the_others_and_is_told(run: Run, kb: Path, logs: Path) -> None:
    (logs / "bad.mcap").write_text("nonsense")
    for verb in ("ingest", "update", "rebuild"):
        result = run("kb", verb, logs, "--kb", kb)
        assert result.code == 3
        assert "bad.mcap" in result.err
    assert len(run("kb", "show", "--kb", kb, "--json").json()["statistics"]["runs"]) == 3
    assert run("kb", "ingest", logs / "bad.mcap", "--kb", kb).code == 1


def test_the_place_may_come_from_the_environment(
    run: Run, kb: Path, logs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("HRCLOG_KB", raising=False)
    result = run("kb", "show")
    assert result.code == 2
    assert "give --kb KB, or set HRCLOG_KB" in result.err
    monkeypatch.setenv("HRCLOG_KB", str(kb))
    assert run("kb", "update", logs).code == 0
    assert run("kb", "show").code == 0


def test_what_cannot_be_done_is_an_error_without_traceback(run: Run, kb: Path, logs: Path, tmp_path: Path) -> None:
    assert "found no knowledge base" in run("kb", "show", "--kb", kb).err
    assert "found no knowledge base" in run("kb", "update", "--kb", kb).err
    assert not kb.exists()
    run("kb", "ingest", logs, "--kb", kb)
    cases = {
        ("withdraw", "nobody"): "no run has the id or the name 'nobody'",
        ("import", tmp_path): "task_results.json",
        ("export", "--to", "mongodb://127.0.0.1:1/db?serverSelectionTimeoutMS=50"): "the server failed",
        ("ingest", tmp_path / "nothing.mcap"): "nothing.mcap",
    }
    for arguments, words in cases.items():
        result = run("kb", *arguments, "--kb", kb)
        assert result.code == 1
        assert words in result.err
        assert "Traceback" not in result.err
    assert run("kb", "export", "--kb", kb).code == 2
    assert run("kb", "withdraw", "n1", "--undo", "--reason", "x", "--kb", kb).code == 2


def test_every_kb_command_has_help_with_an_example(run: Run) -> None:
    for verb in ("ingest", "update", "show", "withdraw", "export", "import", "rebuild"):
        assert f"hrclog kb {verb}" in run("kb", verb, "--help").out.partition("Example:")[2]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_campaign_is_taken_in_as_its_runs_end(run: Run, kb: Path, tmp_path: Path, workers: int) -> None:
    out = tmp_path / "sim"
    options = ("--runs", "30", "--on-run-end", kb, "--workers", workers, "--json")
    result = run("sim", "-o", out, *options)
    assert result.code == 0
    assert len(result.json()["logs"]) == 30
    assert run("kb", "update", out, "--kb", tmp_path / "other.sqlite").code == 0
    assert state_at(kb) == state_at(tmp_path / "other.sqlite")


def test_a_recorded_run_is_taken_in_with_all_its_segments(
    run: Run, kb: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = tmp_path / "run.mcap"
    lines = [{"kind": kind, "agent": "robot", "task": "pick"} for kind in ("task_started", "task_ended")]
    for options in ((), ("--resume",)):
        monkeypatch.setattr("sys.stdin", io.StringIO("".join(f"{json.dumps(line)}\n" for line in lines)))
        assert run("record", log, "--on-run-end", kb, *options).code == 0
    [entry] = run("kb", "show", "--kb", kb, "--json").json()["runs"]
    assert entry["n_executions"] == 2
    assert entry["n_events"] == read_events(tmp_path).height


def test_a_plan_that_is_carried_out_is_taken_in(run: Run, kb: Path, tmp_path: Path) -> None:
    write_plan(tmp_path / "plan.json", plan_of(load_scenario("paper"), 1, 0))
    assert run("run", tmp_path / "plan.json", "-o", tmp_path / "a.mcap", "--on-run-end", kb).code == 0
    shown = run("kb", "show", "--kb", kb, "--json").json()
    assert [entry["name"] for entry in shown["runs"]] == ["a"]
    assert shown["missing_runs"] == 0


def test_a_locked_knowledge_base_costs_no_log_and_can_catch_up(
    run: Run, kb: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hrclog.cli.on_run_end.WAIT_S", 0.1)
    run("sim", "--runs", "1", "--seed", "9", "-o", tmp_path / "first", "--on-run-end", kb)
    holder = sqlite3.connect(kb, isolation_level=None)
    holder.execute("BEGIN IMMEDIATE")
    write_plan(tmp_path / "plan.json", plan_of(load_scenario("paper"), 1, 0))
    monkeypatch.setattr("sys.stdin", io.StringIO('{"kind": "heartbeat"}\n'))
    commands = {
        tmp_path / "sim": ("sim", "--runs", "30", "-o", tmp_path / "sim"),
        tmp_path / "run.mcap": ("run", tmp_path / "plan.json", "-o", tmp_path / "run.mcap"),
        tmp_path / "rec.mcap": ("record", tmp_path / "rec.mcap"),
    }
    for log, command in commands.items():
        result = run(*command, "--on-run-end", kb)
        assert result.code == 3
        assert result.err.count("another process is writing") == 1
        assert f"the logs are kept; catch up with: hrclog kb update {log} --kb {kb}" in result.err
        assert read_events(log).height
    holder.rollback()
    holder.close()
    for log in commands:
        assert run("kb", "update", log, "--kb", kb).code == 0
    assert len(run("kb", "show", "--kb", kb, "--json").json()["runs"]) == 33


def test_what_is_no_knowledge_base_costs_no_log(run: Run, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("notes")
    result = run("sim", "--runs", "2", "-o", tmp_path / "sim", "--on-run-end", tmp_path / "notes.txt", "--json")
    assert result.code == 3
    assert len(result.json()["logs"]) == 2
    assert "no SQLite database" in result.err
    assert (tmp_path / "notes.txt").read_text() == "notes"


def test_a_resumed_campaign_takes_in_what_was_there(
    run: Run, kb: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hrclog.sim.campaign_folder import CampaignFolder

    with monkeypatch.context() as patch:
        patch.setattr(CampaignFolder, "finish", _killed)
        assert run("sim", "--runs", "2", "-o", tmp_path / "sim").code == 130
    assert run("sim", "--runs", "3", "-o", tmp_path / "sim", "--on-run-end", kb).code == 0
    assert len(run("kb", "show", "--kb", kb, "--json").json()["runs"]) == 3


def _killed(*_: object) -> None:
    raise KeyboardInterrupt
