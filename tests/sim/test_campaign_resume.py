"""A campaign that was killed goes on: nothing is done twice, nothing is mixed up, the bytes are the same."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest
from cells import small_cell, small_scenario
from dying import Died, Dying
from folders import names_in

from hrclog.errors import HrclogError, LogExistsError, LogWriteError
from hrclog.sim import campaign, campaign_folder
from hrclog.sim.campaign import simulate_campaign
from hrclog.sim.run import Run, simulate_run
from hrclog.sim.scenario import Lognormal, Scenario, load_scenario

pytestmark = pytest.mark.slow

PAPER = load_scenario("paper")
SMALL = small_scenario(small_cell(), (("robot", "carry_red"), ("human", "carry_white")))
RUNS = 3


def contents(folder: Path) -> dict[str, bytes]:
    """Return the bytes of every file below a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Return the files of a campaign that nobody killed."""
    folder = tmp_path_factory.mktemp("whole")
    simulate_campaign(PAPER, RUNS, 1, folder)
    return contents(folder)


@pytest.fixture(scope="module")
def forty(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Return the files of a campaign of 40 runs that nobody killed."""
    folder = tmp_path_factory.mktemp("forty")
    simulate_campaign(PAPER, 40, 1, folder)
    return contents(folder)


def die(folder: Path, after: int | None, runs: int = RUNS) -> int:
    """Simulate a campaign until so many changes to files are made; return how many there were."""
    with pytest.MonkeyPatch.context() as patch:
        dying = Dying(patch, after)
        with suppress(Died):
            simulate_campaign(PAPER, runs, 1, folder)
        return dying.count


def killed(folder: Path, runs_done: int, runs: int = 5, scenario: Scenario = PAPER, engine: str = "events") -> None:
    """Leave a folder as a campaign leaves it that is killed before it begins the run of that number."""

    def simulate(*arguments: object, **named: object) -> Run:
        if arguments[2] == runs_done:
            raise Died
        return simulate_run(*arguments, **named)  # type: ignore[arg-type] - as it was called

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(campaign, "simulate_run", simulate)
        with pytest.raises(Died):
            simulate_campaign(scenario, runs, 1, folder, engine=engine)


def simulated(patch: pytest.MonkeyPatch) -> list[int]:
    """Return the list that the numbers of the runs simulated from now on go to."""
    numbers: list[int] = []

    def simulate(scenario: Scenario, seed: int, index: int, engine: str) -> Run:
        numbers.append(index)
        return simulate_run(scenario, seed, index, engine=engine)

    patch.setattr(campaign, "simulate_run", simulate)
    return numbers


def check_death(folder: Path, after: int, whole: dict[str, bytes]) -> None:
    die(folder, after)
    there = contents(folder)
    # nothing that has a name of its own is ever half there
    assert all(whole[name] == content for name, content in there.items() if "/" not in name and name[0] != ".")
    if "truth.json" in there and ".campaign/manifest.json" not in there:
        with pytest.raises(LogExistsError):  # it was finished
            simulate_campaign(PAPER, RUNS, 1, folder)
    else:
        simulate_campaign(PAPER, RUNS, 1, folder)
    assert contents(folder) == whole
    assert names_in(folder) == sorted(whole)


def changes(tmp_path: Path) -> int:
    return die(tmp_path / "all", None)


def test_a_campaign_may_die_between_any_two_changes_to_files(tmp_path: Path, whole: dict[str, bytes]) -> None:
    count = changes(tmp_path)
    assert count > 20
    for after in [*range(0, count - 12, 3), *range(count - 12, count)]:
        check_death(tmp_path / str(after), after, whole)


def test_it_may_die_again_and_again(tmp_path: Path, whole: dict[str, bytes]) -> None:
    deaths = 0
    while "truth.json" not in contents(tmp_path) and deaths < 100:
        die(tmp_path, 24)
        deaths += 1
    assert 3 <= deaths < 100
    if (tmp_path / ".campaign").exists():
        simulate_campaign(PAPER, RUNS, 1, tmp_path)
    assert contents(tmp_path) == whole


@pytest.mark.parametrize("done", [1, 4])
def test_what_is_there_is_not_simulated_again(done: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    killed(tmp_path, done)
    numbers = simulated(monkeypatch)
    told: list[int] = []
    paths = simulate_campaign(PAPER, 5, 1, tmp_path, resuming=told.append)
    assert numbers == list(range(done, 5))
    assert told == [done]
    assert [path.name for path in paths] == [f"paper_{index:04d}.mcap" for index in range(5)]
    assert names_in(tmp_path) == [*(path.name for path in paths), "truth.json"]


def test_a_new_campaign_resumes_nothing(tmp_path: Path) -> None:
    told: list[int] = []
    simulate_campaign(PAPER, 1, 1, tmp_path, resuming=told.append)
    assert told == []


@pytest.mark.parametrize("lost", ["paper_0001.mcap", ".campaign/paper_0001.json"])
def test_a_log_without_its_truth_and_a_truth_without_its_log_are_made_again(
    lost: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulate_campaign(PAPER, 5, 1, tmp_path / "whole")
    killed(tmp_path / "out", 3)
    (tmp_path / "out" / lost).unlink()
    numbers = simulated(monkeypatch)
    simulate_campaign(PAPER, 5, 1, tmp_path / "out")
    assert numbers == [1, 3, 4]
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"run_id": "r", "name": "n", "executions": [1]}'])
def test_a_damaged_truth_of_a_run_is_made_again(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    killed(tmp_path, 2, 3)
    (tmp_path / ".campaign" / "paper_0001.json").write_text(text)
    numbers = simulated(monkeypatch)
    simulate_campaign(PAPER, 3, 1, tmp_path)
    assert numbers == [1, 2]


def test_a_log_that_is_not_of_the_campaign_is_not_overwritten(tmp_path: Path) -> None:
    killed(tmp_path, 1, 3)
    (tmp_path / "paper_0002.mcap").write_text("mine")
    with pytest.raises(
        LogExistsError, match=r"paper_0002\.mcap: exists already.* not what run paper_0002 of this camp"
    ):
        simulate_campaign(PAPER, 3, 1, tmp_path)
    assert (tmp_path / "paper_0002.mcap").read_text() == "mine"


OTHERS: list[tuple[str, Callable[[Path], object], str]] = [
    (
        "another seed",
        lambda out: simulate_campaign(PAPER, 5, 2, out),
        r"\.campaign: exists already.*unfinished campaign: 5 runs of paper, seed 1, engine events; finish it with its",
    ),
    (
        "another scenario",
        lambda out: simulate_campaign(load_scenario("failures"), 5, 1, out),
        "5 runs of paper, seed 1",
    ),
    (
        "another scenario of that name",
        lambda out: simulate_campaign(replace(PAPER, description="other"), 5, 1, out),
        "engine events, whose scenario said something else; finish",
    ),
    (
        "fewer runs than there are",
        lambda out: simulate_campaign(PAPER, 1, 1, out),
        r"paper_0001\.mcap.*at least 2 runs",
    ),
]


@pytest.mark.parametrize(("what", "simulate", "message"), OTHERS, ids=[other[0] for other in OTHERS])
def test_another_campaign_in_the_folder_is_named_and_left_alone(
    what: str, simulate: Callable[[Path], object], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    killed(tmp_path, 2)
    before = contents(tmp_path)
    numbers = simulated(monkeypatch)
    with pytest.raises(LogExistsError, match=message):
        simulate(tmp_path)
    assert numbers == [], what
    assert contents(tmp_path) == before


def test_another_version_does_not_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    killed(tmp_path, 2)
    monkeypatch.setattr(campaign_folder, "__version__", "9.9")
    with pytest.raises(LogExistsError, match=r"engine events, by hrclog \d+\.\d+\.\d+; finish it"):
        simulate_campaign(PAPER, 5, 1, tmp_path)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"runs": 3}'])
def test_a_manifest_that_cannot_be_read_is_an_error(text: str, tmp_path: Path) -> None:
    killed(tmp_path, 2)
    (tmp_path / ".campaign" / "manifest.json").write_text(text)
    with pytest.raises(
        LogExistsError, match=r"manifest\.json: exists.*cannot be read as a campaign.*remove .*\.campaign"
    ):
        simulate_campaign(PAPER, 5, 1, tmp_path)


def test_a_finished_campaign_in_the_folder_is_named(tmp_path: Path) -> None:
    simulate_campaign(load_scenario("failures"), 2, 8, tmp_path)
    with pytest.raises(
        LogExistsError, match=r"a finished campaign is there: 2 runs of failures, seed 8, engine events"
    ):
        simulate_campaign(PAPER, 2, 1, tmp_path)


@pytest.mark.parametrize("runs", [4, 7])
def test_a_campaign_that_goes_on_may_have_more_or_fewer_runs(
    runs: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulate_campaign(PAPER, runs, 1, tmp_path / "whole")
    killed(tmp_path / "out", 3, 5)
    numbers = simulated(monkeypatch)
    simulate_campaign(PAPER, runs, 1, tmp_path / "out")
    assert numbers == list(range(3, runs))
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


def test_more_runs_are_not_written_over_what_was_there_before(tmp_path: Path) -> None:
    tmp_path.joinpath("paper_0006.mcap").write_text("mine")
    killed(tmp_path, 3, 5)
    with pytest.raises(LogExistsError, match=r"paper_0006\.mcap: exists already.*5 runs of paper.* did not write it"):
        simulate_campaign(PAPER, 7, 1, tmp_path)


def test_more_runs_than_a_campaign_that_died_after_its_last(tmp_path: Path, whole: dict[str, bytes]) -> None:
    last = next(
        after
        for after in range(changes(tmp_path), 0, -1)
        if die(tmp_path / str(after), after) == after and (tmp_path / str(after) / ".campaign/manifest.json").exists()
    )
    out = tmp_path / str(last)
    assert (out / "truth.json").read_bytes() == whole["truth.json"]
    simulate_campaign(PAPER, RUNS + 2, 1, out)
    simulate_campaign(PAPER, RUNS + 2, 1, tmp_path / "whole")
    assert contents(out) == contents(tmp_path / "whole")


def test_files_of_others_in_the_folder_stay(tmp_path: Path) -> None:
    killed(tmp_path, 2, 3)
    (tmp_path / ".hrclog-1-2.tmp").write_text("a recorder's")
    (tmp_path / ".campaign" / "notes").write_text("mine")
    simulate_campaign(PAPER, 3, 1, tmp_path)
    assert (tmp_path / ".hrclog-1-2.tmp").exists()
    assert names_in(tmp_path / ".campaign") == ["notes"]


@pytest.mark.skipif(os.name != "posix", reason="folders cannot be locked")
def test_two_campaigns_in_one_folder_at_a_time_are_refused(tmp_path: Path) -> None:
    def second(_count: int) -> None:
        with pytest.raises(
            LogWriteError, match=r"another process is simulating into this folder; wait until it is done"
        ):
            simulate_campaign(PAPER, 2, 1, tmp_path)

    simulate_campaign(PAPER, 2, 1, tmp_path, progress=second)
    assert len(names_in(tmp_path)) == 3


@pytest.mark.slow
def test_serial_and_parallel_resumption_give_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaign, "_BATCH", 1)
    simulate_campaign(PAPER, 5, 1, tmp_path / "whole")
    killed(tmp_path / "one", 2)
    shutil.copytree(tmp_path / "one", tmp_path / "two")
    simulate_campaign(PAPER, 5, 1, tmp_path / "one")
    simulate_campaign(PAPER, 5, 1, tmp_path / "two", workers=2)
    assert contents(tmp_path / "one") == contents(tmp_path / "two") == contents(tmp_path / "whole")


def test_a_stepped_campaign_goes_on_under_the_same_policy_only(tmp_path: Path) -> None:
    pytest.importorskip("pybullet")
    from hrclog.sim.bullet.engine import with_policy

    simulate_campaign(SMALL, 3, 1, tmp_path / "whole", engine="bullet")
    killed(tmp_path / "out", 1, 3, SMALL, "bullet")
    there = r"3 runs of small, seed 1, engine bullet, safety areas; finish"
    with pytest.raises(LogExistsError, match=there):
        simulate_campaign(with_policy(SMALL, "ssm"), 3, 1, tmp_path / "out", engine="bullet")
    with pytest.raises(LogExistsError, match=there):
        simulate_campaign(SMALL, 3, 1, tmp_path / "out", engine="events")
    changed = replace(SMALL, cell=small_cell({"robot.speed": 0.4}))
    with pytest.raises(LogExistsError, match="whose scenario said something else"):
        simulate_campaign(changed, 3, 1, tmp_path / "out", engine="bullet")
    simulate_campaign(SMALL, 3, 1, tmp_path / "out", engine="bullet")
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


def test_the_cell_does_not_matter_to_discrete_events(tmp_path: Path) -> None:
    scenario = replace(SMALL, works=tuple(replace(work, time=Lognormal(4.0, 0.1)) for work in SMALL.works))
    killed(tmp_path, 1, 3, scenario)
    simulate_campaign(replace(scenario, cell=small_cell({"robot.speed": 0.4})), 3, 1, tmp_path)


def start(folder: Path, *options: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "hrclog", "sim", "--seed", "1", "-o", str(folder), *options]
    return subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def kill_after(process: subprocess.Popen[str], folder: Path, logs: int, wait_s: float = 0.0) -> None:
    """Kill a campaign once so many logs are there and some time has gone by."""
    until = time.monotonic() + 60.0
    while len(list(folder.glob("*.mcap"))) < logs and process.poll() is None:
        assert time.monotonic() < until
        time.sleep(0.001)
    time.sleep(wait_s)
    process.send_signal(signal.SIGKILL)
    process.communicate()


def go_on(folder: Path, *options: str) -> str:
    process = start(folder, *options)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    return err


def test_the_command_goes_on_after_it_was_killed(tmp_path: Path, forty: dict[str, bytes]) -> None:
    options = "--runs", "40"
    kill_after(start(tmp_path / "out", *options), tmp_path / "out", 10)
    there = len(list((tmp_path / "out" / ".campaign").glob("*_*.json")))
    assert 10 <= there + 1 < 40
    assert f"resuming: {there} of 40 runs are there" in go_on(tmp_path / "out", *options)
    assert contents(tmp_path / "out") == forty
    assert len(names_in(tmp_path / "out")) == 41


@pytest.mark.slow
@pytest.mark.parametrize("workers", ["1", "2"])
def test_the_command_may_be_killed_at_any_moment(workers: str, tmp_path: Path, forty: dict[str, bytes]) -> None:
    options = "--runs", "40", "--workers", workers
    for number, (logs, wait_s) in enumerate([(0, 0.3), (1, 0.0), (18, 0.003), (31, 0.007)]):
        out = tmp_path / str(number)
        kill_after(start(out, *options), out, logs, wait_s)
        kill_after(start(out, *options), out, 0, 0.5)
        if not (out / "truth.json").exists():  # else it was done before the kill
            go_on(out, *options)
        assert contents(out) == forty
        assert not (out / ".campaign").exists()


@pytest.mark.slow
def test_a_stepped_campaign_of_two_workers_goes_on_after_it_was_killed(tmp_path: Path, paper: Scenario) -> None:
    pytest.importorskip("pybullet")
    options = "--runs", "4", "--engine", "bullet", "--workers", "2"
    simulate_campaign(paper, 4, 1, tmp_path / "whole", engine="bullet")
    kill_after(start(tmp_path / "out", *options), tmp_path / "out", 2, 0.5)
    go_on(tmp_path / "out", *options)
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


def children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def workers_of(process: subprocess.Popen[str]) -> list[int]:
    until = time.monotonic() + 60.0
    found: list[int] = []
    while len(found) < 2 and time.monotonic() < until:
        found = [pid for pid in children(process.pid) if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()]
        time.sleep(0.01)
    return found


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="processes are found in /proc")
def test_workers_end_with_a_campaign_that_is_killed(tmp_path: Path) -> None:
    process = start(tmp_path, "--runs", "4000", "--workers", "2")
    workers = workers_of(process)
    kill_after(process, tmp_path, 1)
    until = time.monotonic() + 10.0
    while any(Path(f"/proc/{pid}").exists() for pid in workers) and time.monotonic() < until:
        time.sleep(0.05)
    assert len(workers) == 2
    assert not any(Path(f"/proc/{pid}").exists() for pid in workers)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="processes are found in /proc")
def test_a_worker_that_is_killed_is_an_error_and_the_campaign_goes_on(tmp_path: Path) -> None:
    simulate_campaign(PAPER, 150, 1, tmp_path / "whole")
    process = start(tmp_path / "out", "--runs", "150", "--workers", "2")
    worker = workers_of(process)[0]
    while not any((tmp_path / "out").glob("*.mcap")):
        time.sleep(0.01)
    os.kill(worker, signal.SIGKILL)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert err.strip().splitlines()[-1].startswith("hrclog: error: a worker process was killed")
    assert "resuming" in go_on(tmp_path / "out", "--runs", "150")
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


def test_an_error_keeps_what_was_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(folder: Path, run: Run) -> None:
        if run.truth.name == "paper_0002":
            raise LogWriteError(folder, "the disk is full", "free space")
        campaign_folder.add_run(folder, run)

    with monkeypatch.context() as patch:
        patch.setattr(campaign, "add_run", full)
        with pytest.raises(HrclogError, match="the disk is full"):
            simulate_campaign(PAPER, 5, 1, tmp_path)
    numbers = simulated(monkeypatch)
    simulate_campaign(PAPER, 5, 1, tmp_path)
    assert numbers == [2, 3, 4]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_finished_campaign_is_extended_to_the_bytes_of_a_longer_one(
    workers: int, whole: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulate_campaign(PAPER, 1, 1, tmp_path)
    told: list[int] = []
    numbers = simulated(monkeypatch) if workers == 1 else None
    simulate_campaign(PAPER, RUNS, 1, tmp_path, workers, resuming=told.append)
    assert contents(tmp_path) == whole
    assert told == [1]
    assert numbers in (None, [1, 2])  # what is there is not simulated again


def test_an_extension_may_be_killed_at_any_moment(whole: dict[str, bytes], tmp_path: Path) -> None:
    simulate_campaign(PAPER, 1, 1, tmp_path / "first")
    count = die(shutil.copytree(tmp_path / "first", tmp_path / "alive"), None)
    for after in range(0, count, 3):
        folder = shutil.copytree(tmp_path / "first", tmp_path / str(after))
        die(folder, after)
        over = (folder / "truth.json").read_bytes() == whole["truth.json"]  # but for clearing up
        with suppress(*[LogExistsError] * over):
            simulate_campaign(PAPER, RUNS, 1, folder)
        assert contents(folder) == whole, after


def test_only_the_same_campaign_is_extended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    simulate_campaign(PAPER, 2, 1, tmp_path)
    before = contents(tmp_path)
    changed = replace(PAPER, works=(replace(PAPER.works[0], path_length=9.0), *PAPER.works[1:]))
    for scenario, runs, seed in ((PAPER, 3, 2), (changed, 3, 1), (PAPER, 2, 1), (PAPER, 1, 1)):
        with pytest.raises(LogExistsError, match="a finished campaign is there: 2 runs of paper, seed 1"):
            simulate_campaign(scenario, runs, seed, tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(campaign_folder, "__version__", "9.9")
        with pytest.raises(LogExistsError, match="a finished campaign is there"):
            simulate_campaign(PAPER, 3, 1, tmp_path)
    (tmp_path / "paper_0002.mcap").write_bytes(b"mine")
    with pytest.raises(LogExistsError, match="exists already"):
        simulate_campaign(PAPER, 3, 1, tmp_path)
    (tmp_path / "paper_0002.mcap").unlink()
    assert contents(tmp_path) == before
