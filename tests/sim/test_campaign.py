"""Campaigns: the same bytes however they are made, nothing overwritten, nothing skipped."""

from __future__ import annotations

from pathlib import Path

import pytest

from hrclog.errors import HrclogError, LogExistsError, OutputError, ScenarioError
from hrclog.event_rows import from_row
from hrclog.log.reader import read_events
from hrclog.problem import Count, Problem, Task
from hrclog.sim import campaign
from hrclog.sim.campaign import simulate_campaign
from hrclog.sim.run import simulate_run
from hrclog.sim.scenario import Lognormal, Safety, Scenario, Synergy, Work, load_scenario
from hrclog.sim.truth import read_truth

PAPER = load_scenario("paper")


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
