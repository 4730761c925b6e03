"""`hrclog sim`."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from hrclog.cli import main
from hrclog.sim.scenario import scenario_names


def test_logs_and_truth_are_written_and_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "out"
    assert main(["sim", "--scenario", "failures", "--runs", "3", "--seed", "2", "-o", str(folder)]) == 0
    captured = capsys.readouterr()
    assert captured.out.startswith(
        f"3 runs of failures: {folder / 'failures_0000.mcap'} .. failures_0002.mcap, truth in"
    )
    assert captured.err == ""
    assert len(list(folder.iterdir())) == 4


def test_json_is_one_object_that_names_every_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sim", "--runs", "2", "-o", str(tmp_path), "--json", "--engine", "events"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["scenario"], result["engine"], result["seed"]) == ("paper", "events", 1)
    assert [Path(path).is_file() for path in [*result["logs"], result["truth"]]] == [True] * 3


def test_a_second_campaign_does_not_overwrite_the_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["sim", "--runs", "1", "-o", str(tmp_path)]
    assert main(command) == 0
    assert main(command) == 1
    assert "exists already, not overwriting it; choose an empty folder with -o" in capsys.readouterr().err


def test_a_bad_scenario_file_is_an_error_before_anything_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bad.json").write_text("{")
    assert main(["sim", "--scenario", str(tmp_path / "bad.json"), "-o", str(tmp_path / "out")]) == 1
    assert "bad.json: not JSON" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("options", [["--runs", "0"], ["--workers", "0"], ["--engine", "steam"], []])
def test_wrong_usage_exits_with_2(options: list[str], tmp_path: Path) -> None:
    output = ["-o", str(tmp_path)] if options else []
    assert main(["sim", *options, *output]) == 2


def test_help_names_every_scenario_and_shows_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sim", "--help"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert all(name in text for name in scenario_names())
    assert "hrclog sim --scenario paper --runs 50 --seed 1 -o simulated" in text


def test_the_simulator_needs_no_heavy_imports() -> None:
    code = (
        "import sys, hrclog.sim.run, hrclog.sim.scenario;"
        "print(sorted({'numpy', 'polars', 'pybullet', 'rerun'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
