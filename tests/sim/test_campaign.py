"""Campaigns: the same bytes however they are made, nothing overwritten, nothing skipped."""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path

import pytest
from cells import small_cell, small_scenario
from folders import names_in

from hrclog.errors import HrclogError, LogExistsError, OutputError, ScenarioError
from hrclog.event_rows import from_row
from hrclog.log.reader import read_events
from hrclog.log.writing.writer import write_log
from hrclog.planning.problem import Count, Problem, Task
from hrclog.sim import campaign
from hrclog.sim.bullet.observed import observed_truth
from hrclog.sim.campaign import simulate_campaign
from hrclog.sim.run import Run, simulate_run
from hrclog.sim.scenario import Lognormal, Safety, Scenario, Synergy, Work, load_scenario
from hrclog.sim.truth import read_truth

pytestmark = pytest.mark.slow

PAPER = load_scenario("paper")
SMALL = small_scenario(small_cell(), (("robot", "carry_red"), ("human", "carry_white")))


def contents(folder: Path) -> dict[str, bytes]:
    """Return the bytes of every file of a folder."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def test_serial_and_parallel_campaigns_are_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaign, "_BATCH", 2)
    paths = simulate_campaign(PAPER, 5, 1, tmp_path / "one")
    simulate_campaign(PAPER, 5, 1, tmp_path / "two", workers=2)
    assert [path.name for path in paths] == [f"paper_{index:04d}.mcap" for index in range(5)]
    assert contents(tmp_path / "one") == contents(tmp_path / "two")
    assert set(contents(tmp_path / "one")) == {*(path.name for path in paths), "truth.json"}


def test_another_seed_gives_other_bytes_and_more_runs_keep_the_first(tmp_path: Path) -> None:
    simulate_campaign(PAPER, 2, 1, tmp_path / "a")
    simulate_campaign(PAPER, 2, 2, tmp_path / "b")
    simulate_campaign(PAPER, 3, 1, tmp_path / "c")
    a, b, c = (contents(tmp_path / name) for name in "abc")
    assert all(a[name] != b[name] for name in a)
    assert all(a[name] == c[name] for name in a if name != "truth.json")


def test_a_log_holds_the_events_of_its_run_and_the_truth_its_work(tmp_path: Path) -> None:
    paths = simulate_campaign(load_scenario("failures"), 3, 5, tmp_path)
    runs = [simulate_run(load_scenario("failures"), 5, index) for index in range(3)]
    for path, run in zip(paths, runs, strict=True):
        rows = read_events(path).iter_rows(named=True)
        assert tuple(from_row(row) for row in rows) == run.events
    assert read_truth(tmp_path / "truth.json").runs == tuple(run.truth for run in runs)


@pytest.mark.parametrize("name", ["paper_0001.mcap", "truth.json"])
def test_nothing_is_simulated_if_a_file_would_be_overwritten(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("mine")
    with pytest.raises(LogExistsError, match=rf"{name}: exists already.*choose an empty folder with -o"):
        simulate_campaign(PAPER, 2, 1, tmp_path)
    assert contents(tmp_path) == {name: b"mine"}


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"file/logs: cannot be made"):
        simulate_campaign(PAPER, 1, 1, tmp_path / "file" / "logs")


@pytest.mark.parametrize(("runs", "workers", "message"), [(0, 1, "runs: found 0"), (1, 0, "workers: found 0")])
def test_numbers_out_of_range_are_refused(runs: int, workers: int, message: str, tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=message):
        simulate_campaign(PAPER, runs, 1, tmp_path / "out", workers=workers)
    assert not (tmp_path / "out").exists()


def test_progress_counts_every_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaign, "_BATCH", 2)
    told: list[int] = []
    simulate_campaign(PAPER, 5, 1, tmp_path, progress=told.append)
    assert told == [2, 2, 1]


def stuck() -> Scenario:
    """Return a cell in which every run comes to a standstill."""
    agents = ("a", "b", "c")
    return Scenario(
        "stuck",
        Problem(agents, (Task("t", agents),), tuple(Count("t", 1, agent) for agent in agents)),
        tuple(Work(agent, "t", Lognormal(10.0, 0.0)) for agent in agents),
        tuple(Synergy(one, "t", two, "t", float("inf")) for one, two in (("a", "b"), ("b", "c"), ("c", "a"))),
        safety=Safety(agents),
    )


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_in_a_run_is_raised_and_leaves_no_truth(
    workers: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(campaign, "_BATCH", 1)
    with pytest.raises(HrclogError, match="stuck: standstill"):
        simulate_campaign(stuck(), 3, 1, tmp_path, workers=workers)
    assert contents(tmp_path) == {}


def sometimes_stuck() -> Scenario:
    """Return a cell that comes to a standstill where all agents begin with the same task."""
    agents = ("a", "b", "c")
    keys = [(agent, task) for agent in agents for task in ("t", "u")]
    return Scenario(
        "sometimes",
        Problem(agents, (Task("t", agents), Task("u", agents)), tuple(Count(task, 1, agent) for agent, task in keys)),
        tuple(Work(*key, Lognormal(10.0, 0.0)) for key in keys),
        tuple(Synergy(one, "t", two, "t", float("inf")) for one, two in (("a", "b"), ("b", "c"), ("c", "a"))),
        safety=Safety(agents),
    )


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_run_that_fails_is_told_at_the_end_and_hides_no_other(
    workers: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(campaign, "_BATCH", 2)
    scenario, runs = sometimes_stuck(), 24
    fine: list[str] = []
    for index in range(runs):
        with suppress(ScenarioError):
            fine.append(simulate_run(scenario, 1, index).truth.name)
    failed = runs - len(fine)
    assert 3 < failed < 12
    told: list[int] = []
    message = (
        rf"{failed} of 24 runs failed, the others are written; .*: sometimes_00.*: .*standstill.*and {failed - 3} more"
    )
    with pytest.raises(ScenarioError, match=message):
        simulate_campaign(scenario, runs, 1, tmp_path, workers=workers, progress=told.append)
    assert sum(told) == runs
    assert names_in(tmp_path) == [".campaign", *(f"{name}.mcap" for name in fine)]
    there: list[int] = []
    with pytest.raises(ScenarioError, match="standstill"):
        simulate_campaign(scenario, runs, 1, tmp_path, resuming=there.append)
    assert there == [len(fine)]


def test_a_run_that_breaks_something_is_named_and_leaves_its_trace(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(scenario: Scenario, seed: int, index: int, engine: str) -> Run:
        if index == 1:
            raise RuntimeError("the arm fell off")
        return simulate_run(scenario, seed, index, engine=engine)

    monkeypatch.setattr(campaign, "simulate_run", broken)
    with pytest.raises(
        ScenarioError, match=r"1 of 3 runs failed.*: paper_0001: RuntimeError: the arm fell off"
    ) as caught:
        simulate_campaign(PAPER, 3, 1, tmp_path)
    assert "in broken" in caught.value.__notes__[0]
    assert names_in(tmp_path) == [".campaign", "paper_0000.mcap", "paper_0002.mcap"]


def test_a_stepped_campaign_holds_its_signals_and_the_truth_that_was_observed(tmp_path: Path) -> None:
    pytest.importorskip("pybullet")
    told: list[int] = []
    paths = simulate_campaign(SMALL, 2, 1, tmp_path / "out", progress=told.append, engine="bullet")
    assert told == [1, 1]
    runs = [simulate_run(SMALL, 1, index, engine="bullet") for index in range(2)]
    assert all(run.signals for run in runs)
    for run, path in zip(runs, paths, strict=True):
        write_log(tmp_path / path.name, run.events, run.signals)
        assert (tmp_path / path.name).read_bytes() == path.read_bytes()
    truth = read_truth(tmp_path / "out" / "truth.json")
    assert truth == observed_truth(SMALL, small_cell(), 1, "bullet", [run.truth for run in runs])
    assert all(run.contacts is not None for run in truth.runs)
    assert any(pair.synergy is not None for pair in truth.synergies)


@pytest.mark.slow
def test_stepped_campaigns_are_the_same_bytes_serial_and_parallel(tmp_path: Path) -> None:
    pytest.importorskip("pybullet")
    simulate_campaign(SMALL, 3, 1, tmp_path / "one", engine="bullet")
    simulate_campaign(SMALL, 3, 1, tmp_path / "two", workers=2, engine="bullet")
    assert contents(tmp_path / "one") == contents(tmp_path / "two")


def test_what_the_engine_cannot_do_is_said_before_anything_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    with pytest.raises(ScenarioError, match="engine 'steam': unknown"):
        simulate_campaign(PAPER, 1, 1, out, engine="steam")
    with pytest.raises(ScenarioError, match="has no cell, which the engine 'bullet' needs"):
        simulate_campaign(stuck(), 1, 1, out, engine="bullet")
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "pybullet", None)
        with pytest.raises(ScenarioError, match="needs PyBullet"):
            simulate_campaign(SMALL, 1, 1, out, engine="bullet")
    assert not out.exists()


def test_what_is_out_of_reach_is_said_before_anything_is_written(tmp_path: Path) -> None:
    pytest.importorskip("pybullet")
    far = small_scenario(small_cell({"slots.0.positions": [[9.0, 9.0, 1.0]]}), (("robot", "carry_red"),))
    with pytest.raises(ScenarioError, match="reach"):
        simulate_campaign(far, 1, 1, tmp_path / "out", engine="bullet")
    assert not (tmp_path / "out").exists()
