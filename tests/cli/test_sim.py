"""`hrclog sim`."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from cells import small_cell, small_scenario
from folders import names_in

from hrclog.cli import main, sim
from hrclog.sim import scenario
from hrclog.sim.engine import ENGINES
from hrclog.sim.scenario import scenario_names
from hrclog.sim.truth import RunTruth, Truth, write_truth


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


@pytest.mark.parametrize(
    "options",
    [
        ["--runs", "0"],
        ["--workers", "0"],
        ["--engine", "steam"],
        ["--engine", "bullet", "--safety", "prayer"],
        ["--safety", "ssm"],
        ["--engine", "events", "--safety", "areas"],
        [],
    ],
)
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


def test_a_policy_for_discrete_events_is_explained(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sim", "--safety", "ssm", "-o", str(tmp_path / "out")]) == 2
    assert "--safety goes with --engine bullet" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_scenario_without_a_cell_is_an_error_before_anything_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for safety in ([], ["--safety", "ssm"]):
        options = ["--scenario", "three-agents", "--engine", "bullet", *safety]
        assert main(["sim", *options, "-o", str(tmp_path / "out")]) == 1
        assert "scenario 'three-agents': it has no cell" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_without_pybullet_the_stepped_cell_is_an_error_before_anything_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pybullet", None)
    assert main(["sim", "--engine", "bullet", "-o", str(tmp_path / "out")]) == 1
    captured = capsys.readouterr()
    assert captured.err.startswith("hrclog: error: the engine 'bullet' needs PyBullet")
    assert captured.out == ""
    assert not (tmp_path / "out").exists()


def test_contacts_are_those_of_all_runs(tmp_path: Path) -> None:
    runs = tuple(RunTruth("r", "n", (), (), contacts) for contacts in (2, 0, 1))
    write_truth(tmp_path / "truth.json", Truth("s", 1, "bullet", (), (), runs))
    assert sim._contacts(tmp_path / "truth.json") == 3


def test_a_stepped_campaign_counts_contacts_and_says_what_guards(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pybullet")
    small = small_scenario(small_cell(), (("robot", "carry_red"), ("human", "carry_white")))
    monkeypatch.setattr(scenario, "load_scenario", lambda _: small)
    command = ["sim", "--runs", "1", "--engine", "bullet"]
    assert main([*command, "--safety", "distance", "-o", str(tmp_path / "text")]) == 0
    first, second, _ = capsys.readouterr().out.splitlines()
    assert first.startswith("1 run of small: ")
    assert second == "contacts while moving: 0 in 1 run"
    assert main([*command, "--safety", "distance", "--json", "-o", str(tmp_path / "json")]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["engine"], result["safety"], result["contacts"]) == ("bullet", "distance", 0)
    assert json.loads((tmp_path / "json" / "truth.json").read_text())["safety"] == "distance"
    assert (tmp_path / "json" / "small_0000.mcap").read_bytes() == (tmp_path / "text" / "small_0000.mcap").read_bytes()


def test_discrete_events_have_neither_contacts_nor_a_guard(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sim", "--runs", "1", "-o", str(tmp_path), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["safety"], result["contacts"]) == (None, None)


def test_an_unfinished_campaign_is_resumed_and_another_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    command = ["sim", "--scenario", "failures", "--runs", "4", "-o", str(tmp_path)]
    with monkeypatch.context() as patch:
        patch.setattr("hrclog.sim.campaign._truth", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        assert main(command) == 130
    (tmp_path / "failures_0002.mcap").unlink()
    assert main([*command, "--seed", "2"]) == 1
    assert "unfinished campaign: 4 runs of failures, seed 1, engine events" in capsys.readouterr().err
    assert main(command) == 0
    assert capsys.readouterr().err == "resuming: 3 of 4 runs are there\n"
    assert len(names_in(tmp_path)) == 5


@pytest.mark.slow
def test_a_stepped_campaign_is_scored_against_its_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pybullet")
    out = str(tmp_path / "out")
    assert main(["sim", "--runs", "4", "--engine", "bullet", "--workers", "2", "-o", out]) == 0
    truth = str(tmp_path / "out" / "truth.json")
    capsys.readouterr()
    assert main(["score", out, "--truth", truth, "--cv", "2", "--estimator", "aft", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["truth"]["aft"]
    known = sum(row["synergy"] is not None for row in json.loads(Path(truth).read_text())["synergies"])
    assert 10 < found["beside"]["n"] <= known


def test_help_names_the_engines_and_policies(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sim", "--help"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert f"[{'|'.join(ENGINES)}]" in text
    assert "areas, distance, ssm" in text
