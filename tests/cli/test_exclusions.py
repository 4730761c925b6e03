"""Every command that reads logs honours exclusions, and says so once."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import hrclog

Run = Callable[..., Any]


@pytest.fixture
def logs(run: Run, tmp_path: Path) -> Path:
    """Return a folder of four runs, of which one and an execution of another are excluded."""
    folder = tmp_path / "logs"
    assert run("sim", "--runs", 4, "--seed", 6, "-o", folder).code == 0
    first = hrclog.analyze(folder / "paper_0000.mcap").intervals["execution_id"][0]
    assert run("annotate", folder / "paper_0003.mcap", "--exclude", "run", "--reason", "a <b>pilot</b>").code == 0
    said = run(
        "annotate", folder, "--exclude", first[:30], "--reason", "pressed too early", "--author", "Ada", "--json"
    )
    assert [len(entry["judged"]) for entry in said.json()["runs"]] == [1]
    return folder


def test_commands_leave_out_what_is_excluded_and_say_so_once(run: Run, logs: Path, tmp_path: Path) -> None:
    commands = (
        ("analyze", logs, "-o", tmp_path / "out", "--recordings", 1),
        ("check", logs),
        ("info", logs),
        ("export", logs, "-o", tmp_path / "tables"),
        ("report", logs, "-o", tmp_path / "report.html", "--runs", 0),
        ("score", logs, "--cv", 2, "--estimator", "ols"),
        ("compare", logs / "paper_0000.mcap", logs / "paper_000[12].mcap", "--bootstrap", 0, "--estimator", "ols"),
        ("kb", "update", logs, "--kb", tmp_path / "kb.sqlite", "--estimator", "ols"),
    )
    for command in commands:
        done = run(*command)
        assert done.code == 0, done.err
        assert done.err.count("[excluded]") == 1, (command, done.err)
    listed = run("analyze", logs, "-o", tmp_path / "out", "--json", "--recordings", 1).json()
    assert [run_["name"] for run_ in listed["runs"]] == ["paper_0000", "paper_0001", "paper_0002"]
    assert [(entry["verdict"], entry["reason"]) for entry in listed["exclusions"]] == [
        ("excluded", "a <b>pilot</b>"),
        ("excluded", "pressed too early"),
    ]
    page = (tmp_path / "report.html").read_text()
    assert "a &lt;b&gt;pilot&lt;/b&gt;" in page
    assert "pressed too early" in page


def test_a_note_and_a_reason_are_two_things(run: Run, logs: Path) -> None:
    assert run("annotate", logs, "--note", "the light was off").code == 0
    assert run("annotate", logs, "--note", "a", "--reason", "b", "--exclude", "run").code == 2
    assert run("annotate", logs, "--exclude", "run").code == 1
    assert run("annotate", logs).code == 1
    notes = hrclog.read_events(logs).filter(hrclog.read_events(logs)["reason"] == "the light was off")
    assert notes.height == 3


def test_check_excludes_incomplete_runs_where_it_is_asked_to(run: Run, logs: Path, samples: Path) -> None:
    (logs / "broken_off.mcap").write_bytes((samples / "broken_off.mcap").read_bytes())
    assert "excluded" not in run("check", logs / "broken_off.mcap").out
    assert not (logs / "broken_off.annotations.mcap").exists()
    done = run("check", logs / "broken_off.mcap", logs / "paper_0001.mcap", "--annotate", "--author", "Ada")
    assert "1 incomplete run excluded" in done.out
    analysis = hrclog.analyze(logs)
    assert "broken_off" not in analysis.runs["name"].to_list()
    reasons = [entry.reason for entry in analysis.exclusions if entry.author == "Ada"]
    assert any(reason.endswith("(missing_from_plan)") for reason in reasons)
