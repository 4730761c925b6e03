"""The authors' runs as bags of ROS: what is imported is what the import of their dumps gives."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path

import polars as pl
import pytest
import ros_bags as bags
from polars.testing import assert_frame_equal
from real_runs import import_some
from sizes import many

import hrclog
from hrclog.analyzers.projections.intervals import intervals
from hrclog.log.reader import read_logs
from hrclog.recorders.importers.bag import Bag
from hrclog.recorders.importers.writing import import_files

pytestmark = pytest.mark.slow

N_RUNS = many(3, fuzz=51)
STATES = {"succeeded": 4, "canceled": 5, "failed": 6}
ROS1_STATES = {"succeeded": 3, "canceled": 2, "failed": 4}
COLUMNS = ["agent", "task", "start_ns", "end_ns", "outcome"]

Execution = tuple[str, str, int, int, str]


def status_only(executions: Sequence[Execution]) -> list[bags.Sent]:
    """Return the status arrays of an action per agent and task; goals stay in them after their end."""
    sent: list[bags.Sent] = []
    seen: defaultdict[str, list[tuple[str, int, int]]] = defaultdict(list)
    changes = [change for row in executions for change in ((row[2], 1, row), (row[3], 2, row))]
    for time_ns, phase, (agent, task, start, end, outcome) in sorted(changes):
        action, goal = f"/{agent}/{task}", f"{agent}{task}{start}{end}"
        state = 2 if phase == 1 else STATES[outcome]
        kept = [entry for entry in seen[action] if entry[0] != goal]
        seen[action] = [(goal, start - 20_000_000, state), *kept][:4]
        sent.append(bags.status_array(time_ns, action, seen[action]))
    return sent


def with_goals(executions: Sequence[Execution]) -> list[bags.Sent]:
    """Return the messages of one action per agent, whose goals name the tasks."""
    sent: list[bags.Sent] = []
    for number, (agent, task, start, end, outcome) in enumerate(executions):
        action, goal = f"/{agent}/do_task", f"{agent}{task}{start}{end}"
        sent += bags.send_goal(start - 30_000_000, action, goal, task, number)
        sent.append(bags.status_array(start - 20_000_000, action, [(goal, start - 20_000_000, 1)]))
        sent.append(bags.status_array(start, action, [(goal, start - 20_000_000, 2)]))
        sent.append(bags.status_array(end, action, [(goal, start - 20_000_000, STATES[outcome])]))
        sent += bags.get_result(end + 1_000_000, action, goal, STATES[outcome], "", number)
    return sent


def actionlib(executions: Sequence[Execution]) -> list[bags.Sent]:
    """Return the messages of a ROS 1 action per agent; log times are 3 ms late."""
    sent: list[bags.Sent] = []
    for agent, task, start, end, outcome in executions:
        action, goal, late = f"/{agent}/do_task", f"client-{agent}{task}{start}{end}", 3_000_000
        sent.append(bags.ros1_goal(start - 30_000_000, start - 33_000_000, action, goal, task))
        sent.append(bags.ros1_status(start + late, start, action, [(goal, 1)]))
        sent.append(bags.ros1_result(end + late, end, action, goal, ROS1_STATES[outcome]))
        sent.append(bags.ros1_status(end + 2 * late, end + late, action, [(goal, ROS1_STATES[outcome])]))
    return sent


BY_TOPIC = '[[action]]\ntopic = "/{agent}/{task}"\n'
BY_GOAL = '[[action]]\ntopic = "/{agent}/do_task"\ntask = { field = "goal.task" }\n'


@pytest.fixture(scope="module")
def dumps(data_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the logs of some of the authors' runs, as their dumps give them."""
    return import_some(data_dir, tmp_path_factory.mktemp("mongo"), N_RUNS)


@pytest.fixture(scope="module")
def expected(dumps: Path) -> hrclog.Analysis:
    return hrclog.analyze(str(dumps))


@pytest.mark.parametrize(
    ("make", "write", "mapping"),
    [
        (status_only, lambda path, sent: bags.write_bag(path, sent, "mcap", "jazzy"), BY_TOPIC),
        (with_goals, lambda path, sent: bags.write_bag(path, sent, "mcap", "kilted"), BY_GOAL),
        (status_only, lambda path, sent: bags.write_bag(path, sent, "sqlite", "none"), BY_TOPIC),
        (with_goals, lambda path, sent: bags.write_bag(path, sent, "sqlite", "kilted"), BY_GOAL),
        (actionlib, lambda path, sent: bags.write_ros1(path.with_suffix(".bag"), sent), BY_GOAL),
    ],
    ids=["mcap-status", "mcap-goals", "sqlite-status", "sqlite-goals", "ros1"],
)
def test_bags_of_the_authors_runs_give_what_their_dumps_give(
    make: Callable[[Sequence[Execution]], list[bags.Sent]],
    write: Callable[[Path, list[bags.Sent]], Path],
    mapping: str,
    dumps: Path,
    expected: hrclog.Analysis,
    tmp_path: Path,
) -> None:
    for log in sorted(dumps.iterdir()):
        write(tmp_path / "bags" / log.stem, make(executions(log).rows()))
    (tmp_path / "cell.toml").write_text(mapping)
    imported = import_files(Bag(), [tmp_path / "bags"], tmp_path / "logs", map=tmp_path / "cell.toml")
    assert {path.name for path in imported.written} == {path.name for path in dumps.iterdir()}
    assert not [finding for finding in imported.diagnostics if finding.severity == "error"]
    for log in sorted(dumps.iterdir()):
        assert executions(tmp_path / "logs" / log.name).rows() == executions(log).rows()
    analysis = hrclog.analyze(str(tmp_path / "logs"))
    for name in ("durations", "synergies"):
        assert_frame_equal(
            getattr(analysis, name), getattr(expected, name), rel_tol=1e-6
        )  # sums in another order of the runs
    again = import_files(Bag(), [tmp_path / "bags"], tmp_path / "logs", map=tmp_path / "cell.toml")
    assert (len(again.written), len(again.unchanged)) == (0, len(imported.written))


def executions(log: Path) -> pl.DataFrame:
    return intervals(read_logs([log]).events).select(COLUMNS).sort(COLUMNS)
