"""Whole runs of the stepped cell, looked at through their logs by an oracle that knows nothing of PyBullet."""

from __future__ import annotations

import math
import multiprocessing
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from cells import HUMAN, ROBOT, Stage, small_cell, small_plan, small_scenario, with_areas
from segment_distance import Body, box_distances, capsule_distances, least_distances, own_distances
from sizes import many
from small_runs import TASKS as RED_AND_WHITE
from small_runs import digest, digests_of_small_runs, small_run

from hrclog.arrays import BoolArray, FloatArray
from hrclog.errors import ScenarioError
from hrclog.events import AnnotationAdded, Outcome, SafetyStateChanged, TaskEnded, TaskPaused, TaskResumed, TaskStarted
from hrclog.log.messages.encode import DescriptionSignal, FloatSignal, JointSignal, PoseSignal, SceneSignal, Signal
from hrclog.sim.bullet.engine import cell_of, with_policy
from hrclog.sim.bullet.human import standing
from hrclog.sim.bullet.robot import make_arm
from hrclog.sim.bullet.safety import allowed_speed
from hrclog.sim.cell.description import Cell
from hrclog.sim.cell.human_kinematics import HUMAN_JOINT_NAMES, HUMAN_LOWER, HUMAN_UPPER, human_points
from hrclog.sim.cell.robot_kinematics import JOINT_NAMES
from hrclog.sim.cell.safety_settings import POLICIES, SsmSettings
from hrclog.sim.run import Run, simulate_run
from hrclog.sim.scenario import Scenario

BulletRuns = Callable[[str, int], Run]

LOOK_NS = 20_000_000
LOOK_S = 0.02
pytestmark = pytest.mark.slow

SEED = 1
GUARDED = ("distance", "ssm")
EACH_POLICY = pytest.mark.parametrize("policy", POLICIES)
BRAKES_S = 1.5
"""No robot here needs longer to brake."""


class Recorded:
    """The signals of a run, every 20 ms from its start on.

    Args:
        run: what was recorded.
        cell: where.
    """

    def __init__(self, run: Run, cell: Cell) -> None:
        self.run = run
        self.cell = cell
        self.start_ns = run.events[0].time_ns
        self.count = (max(signal.time_ns for signal in run.signals) - self.start_ns) // LOOK_NS + 1
        urdf = {one.agent: one.urdf for one in run.signals if isinstance(one, DescriptionSignal)}
        self.robot_body, self.human_body = Body(urdf[cell.robot.agent]), Body(urdf[cell.human.agent])

    @cached_property
    def robot(self) -> FloatArray:
        """The robot's joints, shape (n, 7)."""
        return self._joints(self.cell.robot.agent)

    @cached_property
    def human(self) -> FloatArray:
        """The human's joints, shape (n, 13)."""
        return self._joints(self.cell.human.agent)

    @cached_property
    def moving(self) -> BoolArray:
        """Whether the robot moves after an instant, shape (n,)."""
        return np.append((self.robot[1:] != self.robot[:-1]).any(axis=1), [False])

    def number(self, name: str) -> FloatArray:
        """Return a scalar signal of the robot, shape (n,)."""
        name = f"{self.cell.robot.agent}/{name}"
        return self._held(
            [
                (one.time_ns, (one.value,))
                for one in self.run.signals
                if isinstance(one, FloatSignal) and one.name == name
            ]
        )[:, 0]

    def _joints(self, agent: str) -> FloatArray:
        return self._held(
            [
                (one.time_ns, one.positions)
                for one in self.run.signals
                if isinstance(one, JointSignal) and one.agent == agent
            ]
        )

    def _held(self, rows: list[tuple[int, tuple[float, ...]]]) -> FloatArray:
        """Return samples at every instant: a value holds until the next."""
        times, values = np.array([time for time, _ in rows]), np.array([value for _, value in rows])
        assert ((times - self.start_ns) % LOOK_NS == 0).all()
        instants = self.start_ns + np.arange(self.count) * LOOK_NS
        return np.asarray(values[np.searchsorted(times, instants, side="right") - 1])


@pytest.fixture(scope="session")
def recorded(bullet_runs: BulletRuns, paper: Scenario) -> Callable[[str], Recorded]:
    """Return the first run of a policy as it was recorded."""
    made: dict[str, Recorded] = {}

    def of(policy: str) -> Recorded:
        if policy not in made:
            made[policy] = Recorded(bullet_runs(policy, 0), cell_of(with_policy(paper, policy)))
        return made[policy]

    return of


Recordings = Callable[[str], Recorded]


# What a sound run is. Each is asserted for one run of each policy, and in the slow campaign for many.


def everything_is_done(run: Run) -> None:
    """Assert that all items of the plan were carried out, without a word about anything odd."""
    assert run.events[-1].kind == "run_ended"
    ends = [event for event in run.events if isinstance(event, TaskEnded)]
    assert {end.outcome for end in ends} == {Outcome.SUCCEEDED}
    assert len(ends) == len(run.truth.executions) == 24
    assert not [event for event in run.events if isinstance(event, AnnotationAdded)]


def time_adds_up(run: Run) -> None:
    """Assert that each execution took its planning, its motion and what it lost."""
    starts = {e.execution_id: e.time_ns for e in run.events if isinstance(e, TaskStarted)}
    ends = {e.execution_id: e for e in run.events if isinstance(e, TaskEnded) and not e.parent_execution_id}
    assert {row.execution_id for row in run.truth.executions} == set(ends)
    for row in run.truth.executions:
        end = ends[row.execution_id]
        took_s = (end.time_ns - starts[row.execution_id]) / 1e9
        assert row.lost_s is not None
        assert row.lost_s >= -1e-9
        assert took_s == pytest.approx(row.work_s + row.lost_s, abs=1e-6)
        assert row.planning_s == pytest.approx(end.planning_time_s or 0.0, abs=1e-9)


Span = tuple[str, str, int, int]


def spans(run: Run) -> list[Span]:
    """Return agent, task, start and end of every execution that is no part of another, from the log."""
    starts = {e.execution_id: e.time_ns for e in run.events if isinstance(e, TaskStarted)}
    return [
        (e.agent, e.task, starts[e.execution_id], e.time_ns)
        for e in run.events
        if isinstance(e, TaskEnded) and not e.parent_execution_id
    ]


def overlaps_are_those_of_the_log(run: Run) -> None:
    """Assert that the truth about pairs fits the intervals in the log, and the losses of executions."""
    expected: dict[tuple[str, str, str, str], int] = defaultdict(int)
    for agent, task, start, end in spans(run):
        for other, other_task, other_start, other_end in spans(run):
            both = min(end, other_end) - max(start, other_start)
            if agent != other and both > 0:
                expected[agent, task, other, other_task] += both
    found = {(p.agent, p.task, p.other_agent, p.other_task): p for p in run.truth.pairs}
    assert set(found) == set(expected)
    lost: dict[str, float] = defaultdict(float)
    for key, pair in found.items():
        assert pair.overlap_s == pytest.approx(expected[key] / 1e9, abs=1e-6)
        assert -1e-9 <= pair.progress_s <= pair.overlap_s + 1e-9
        assert -1e-9 <= pair.caused_progress_s <= pair.overlap_s + 1e-9
        lost[pair.agent] += pair.overlap_s - pair.progress_s
    for agent, lost_s in lost.items():
        rows = [row for row in run.truth.executions if row.agent == agent]
        # the last tick of a motion may do less than its scale would allow
        assert lost_s <= sum(row.lost_s or 0.0 for row in rows) + 0.01 * len(rows)


def distances_are_right(seen: Recorded, step: int = 1) -> None:
    """Assert that the logged distance is that of the oracle, and that the moving robot touches nobody."""
    robot, human = seen.robot[::step], seen.human[::step]
    away = least_distances(seen.robot_body, robot, seen.human_body, human)
    np.testing.assert_allclose(away, seen.number("min_distance")[::step], atol=1e-6)
    assert seen.run.truth.contacts == 0


def nobody_is_touched(seen: Recorded, step: int = 1) -> None:
    """Assert that the robot and the human are apart while the robot moves, between the samples too."""
    at = np.flatnonzero(seen.moving)[::step]
    for share in (0.0, 0.5):
        robot, human = (q[at] + share * (q[at + 1] - q[at]) for q in (seen.robot, seen.human))
        assert least_distances(seen.robot_body, robot, seen.human_body, human).min() > 0.0


def motions_are_possible(seen: Recorded, step: int = 1) -> None:
    """Assert that the robot touches neither itself nor a fixture, and that all joints keep their limits."""
    arm, model = make_arm(seen.cell.robot), seen.cell.robot
    assert own_distances(seen.robot_body, seen.robot[::step]).min() > 0.0
    for box in seen.cell.fixtures:
        assert box_distances(seen.robot_body, seen.robot[::step], box.size, box.position).min() > 0.0, box.name
    assert (seen.robot >= np.array(arm.lower) - 1e-9).all()
    assert (seen.robot <= np.array(arm.upper) + 1e-9).all()
    speeds = np.abs(np.diff(seen.robot, axis=0)) / LOOK_S
    assert (speeds <= np.array(arm.max_velocity) * model.speed + 1e-6).all()
    assert (seen.human >= np.array(HUMAN_LOWER) - 1e-9).all()
    assert (seen.human <= np.array(HUMAN_UPPER) + 1e-9).all()
    assert np.abs(np.diff(seen.human[:, 3:], axis=0)).max() < 0.2, "the human jumps"
    assert np.linalg.norm(np.diff(seen.human[:, :2], axis=0), axis=1).max() < 0.1, "the human jumps"


def objects_end_where_the_log_says(run: Run, cell: Cell) -> None:
    """Assert that what was picked was carried in the hand to the slot in which it was put down."""
    slots = {slot.name: slot.position for slot in cell.slots}
    picked: dict[str, str] = {}
    expected: dict[str, tuple[float, float, float]] = {}
    for end in (event for event in run.events if isinstance(event, TaskEnded)):
        if end.target in slots:
            expected[picked.pop(end.agent)] = slots[end.target]
        else:
            assert end.agent not in picked
            assert end.target not in [*picked.values(), *expected]
            picked[end.agent] = end.target
    assert not picked
    assert len(set(expected.values())) == len(expected) == 12
    last = {one.name: one.position for one in run.signals if isinstance(one, PoseSignal)}
    assert last == expected


@EACH_POLICY
def test_everything_is_done(bullet_runs: BulletRuns, policy: str) -> None:
    everything_is_done(bullet_runs(policy, 0))


@EACH_POLICY
def test_each_execution_took_its_planning_its_motion_and_its_losses(bullet_runs: BulletRuns, policy: str) -> None:
    time_adds_up(bullet_runs(policy, 0))


@EACH_POLICY
def test_the_truth_about_pairs_fits_the_log(bullet_runs: BulletRuns, policy: str) -> None:
    overlaps_are_those_of_the_log(bullet_runs(policy, 0))


@EACH_POLICY
def test_the_logged_distance_is_that_of_the_oracle(recorded: Recordings, policy: str) -> None:
    distances_are_right(recorded(policy), step=5)


@pytest.mark.parametrize("policy", GUARDED)
def test_a_moving_robot_touches_nobody(recorded: Recordings, policy: str) -> None:
    nobody_is_touched(recorded(policy), step=3)


@EACH_POLICY
def test_a_robot_touches_nothing_and_all_joints_keep_their_limits(recorded: Recordings, policy: str) -> None:
    motions_are_possible(recorded(policy), step=10)


@EACH_POLICY
def test_objects_end_where_the_log_says(bullet_runs: BulletRuns, paper: Scenario, policy: str) -> None:
    objects_end_where_the_log_says(bullet_runs(policy, 0), cell_of(paper))


def test_an_object_in_a_hand_is_logged_where_the_hand_is(recorded: Recordings) -> None:
    seen = recorded("areas")
    arm, cell = make_arm(seen.cell.robot), seen.cell
    tips = arm.forward(seen.robot)[:, :3, 3]
    slots = {slot.position for slot in cell.slots}
    carried = Counter[str]()
    for one in seen.run.signals:
        if not isinstance(one, PoseSignal) or one.position in slots:
            continue
        instant = (one.time_ns - seen.start_ns) // LOOK_NS
        hand = human_points(seen.human[instant])[10]
        near = {
            cell.robot.agent: math.dist(one.position, tips[instant]),
            cell.human.agent: math.dist(one.position, hand),
        }
        agent = min(near, key=near.__getitem__)
        assert near[agent] < 1e-9
        carried[agent] += 1
    assert min(carried[agent] for agent in near) > 100


@pytest.mark.parametrize("policy", ["areas", "distance"])
def test_the_robot_is_no_faster_than_its_policy_allows_once_it_has_had_time_to_brake(
    recorded: Recordings, policy: str
) -> None:
    seen = recorded(policy)
    settings = seen.cell.safety
    if policy == "areas":
        points = np.array([human_points(joints) for joints in seen.human])[:, :, :2]
        tips = make_arm(seen.cell.robot).forward(seen.robot)[:, :2, 3]
        limits = np.ones(seen.count)
        for area in settings.areas.areas:
            inside = np.any(np.all((points >= area.low) & (points <= area.high), axis=2), axis=1)
            if area.guarded is not None:
                low, high = area.guarded
                inside &= np.all((tips >= low) & (tips <= high), axis=1)
            limits[inside] = np.minimum(limits[inside], area.scale)
    else:
        away = least_distances(seen.robot_body, seen.robot, seen.human_body, seen.human)
        limits = np.ones(seen.count)
        for band in sorted(settings.distance.bands, key=lambda band: -band.nearer_than_m):
            limits[away < band.nearer_than_m] = band.scale
    scale = seen.number("speed_scale")
    width = round(BRAKES_S / LOOK_S)
    recent = np.array([limits[max(number - width, 0) : number + 1].max() for number in range(seen.count)])
    assert (scale <= recent + 1e-6).all()
    assert (limits == 0.0).any()
    assert (scale == 0.0).any()
    assert (scale >= 0.0).all()


def test_a_robot_at_scale_0_stands(recorded: Recordings) -> None:
    for policy in POLICIES:
        seen = recorded(policy)
        scale = seen.number("speed_scale")
        halted = (scale[:-1] == 0.0) & (scale[1:] == 0.0)
        assert not (halted & seen.moving[:-1]).any()


def closing_speeds(seen: Recorded, step: int) -> tuple[FloatArray, FloatArray]:
    """Return distances between all parts of robot and human, and how fast the robot alone lessens them."""
    at = np.flatnonzero(seen.moving)[::step]
    before = capsule_distances(seen.robot_body, seen.robot[at], seen.human_body, seen.human[at])
    after = capsule_distances(seen.robot_body, seen.robot[at + 1], seen.human_body, seen.human[at])
    return before, (before - after) / LOOK_S


def test_under_separation_no_part_comes_nearer_faster_than_allowed(recorded: Recordings) -> None:
    seen = recorded("ssm")
    settings = seen.cell.safety.ssm
    away, speeds = closing_speeds(seen, step=4)
    # between two looks a robot may speed up, and a human come nearer
    slack = 2 * LOOK_S * max(settings.brakes, settings.deceleration)
    assert (speeds <= allowed_speed(away, settings) + slack).all()
    # it does matter: without a limit some part would have been quicker
    free = closing_speeds(recorded("areas"), step=4)
    assert (free[1] > allowed_speed(free[0], settings) + slack).any()


def test_a_robot_that_separation_slows_goes_just_as_fast_as_it_may() -> None:
    pytest.importorskip("pybullet")
    ssm = {"human_speed": 0.3, "reaction_s": 0.1, "clearance_m": 0.1}
    facing = {
        "human.home": [1.16, 0.8, -90],
        "objects.1.positions": [[1.16, 0.17, 1.03]],
        "safety": {"policy": "ssm", "ssm": ssm},
    }
    items = ((ROBOT, "pick_blue"), (ROBOT, "put"))
    cell = small_cell(facing)
    seen = Recorded(simulate_run(small_scenario(cell, items), SEED, 0, plan=small_plan(*items), engine="bullet"), cell)
    away, speeds = closing_speeds(seen, step=1)
    excess = (speeds - allowed_speed(away, cell.safety.ssm)).max(axis=(1, 2))
    slowed = seen.number("speed_scale")[seen.moving] < 1.0
    assert slowed.sum() > 20
    assert excess.max() <= 2 * LOOK_S * cell.safety.ssm.brakes
    assert np.median(excess[slowed]) == pytest.approx(0.0, abs=0.03)


def test_the_human_is_no_faster_than_separation_takes_it_to_be(recorded: Recordings) -> None:
    seen = recorded("ssm")
    ends = seen.human_body.segments(seen.human)
    assert np.linalg.norm(np.diff(ends, axis=0), axis=-1).max() / LOOK_S <= SsmSettings().human_speed


@EACH_POLICY
def test_a_human_at_home_never_stops_the_robot(recorded: Recordings, policy: str) -> None:
    seen = recorded("areas")
    home = standing(seen.cell.human.home)
    settings = seen.cell.safety
    if policy == "areas":
        red = [area for area in settings.areas.areas if area.scale == 0.0]
        for px, py, _ in human_points(home):
            assert not any(a.low[0] <= px <= a.high[0] and a.low[1] <= py <= a.high[1] for a in red)
        return
    robot = seen.robot[::5]
    away = least_distances(seen.robot_body, robot, seen.human_body, np.tile(home, (len(robot), 1)))
    if policy == "distance":
        assert away.min() >= max(band.nearer_than_m for band in settings.distance.bands if band.scale == 0.0)
    else:
        assert allowed_speed(float(away.min()), settings.ssm) > 0.0


def test_samples_come_in_order_at_most_50_a_second_and_none_twice(bullet_runs: BulletRuns) -> None:
    run = bullet_runs("areas", 0)
    assert [type(one) for one in run.signals[:3]] == [SceneSignal, DescriptionSignal, DescriptionSignal]
    assert {one.run_id for one in run.signals} == {run.truth.run_id}
    times = [one.time_ns for one in run.signals]
    assert times == sorted(times)
    assert times[0] == run.events[0].time_ns
    assert times[-1] <= run.events[-1].time_ns
    channels: dict[tuple[str, str], list[Signal]] = defaultdict(list)
    for one in run.signals:
        name = getattr(one, "name", getattr(one, "agent", ""))
        channels[type(one).__name__, name].append(one)
    for (kind, _), samples in channels.items():
        for before, after in pairwise(samples):
            assert after.time_ns - before.time_ns >= LOOK_NS
            field = {"JointSignal": "positions", "FloatSignal": "value", "PoseSignal": "position"}[kind]
            assert getattr(before, field) != getattr(after, field)
    names = {one.agent: one.names for one in run.signals if isinstance(one, JointSignal)}
    assert names == {"robot": JOINT_NAMES, "human": HUMAN_JOINT_NAMES}


@EACH_POLICY
def test_safety_states_tell_the_scale_and_why(bullet_runs: BulletRuns, policy: str) -> None:
    run = bullet_runs(policy, 0)
    told = [event for event in run.events if isinstance(event, SafetyStateChanged)]
    assert told[0].time_ns == run.events[0].time_ns
    for state in told:
        assert state.agent == "robot"
        assert state.speed_scale is not None
        modes = {
            state.speed_scale == 0.0: "stopped",
            0.0 < state.speed_scale < 1.0: "reduced",
            state.speed_scale == 1.0: "normal",
        }
        assert state.mode == modes[True]
    for before, after in pairwise(told):
        assert before.time_ns < after.time_ns
        assert before.mode != after.mode or abs((before.speed_scale or 0.0) - (after.speed_scale or 0.0)) >= 0.1
    assert len({state.mode for state in told}) > 1
    assert "" not in {state.zone for state in told if state.mode == "stopped"}


# The human costs the robot time, and nothing else.


def works(run: Run, agent: str) -> list[tuple[str, float, float | None]]:
    """Return task, work and planning of the executions of an agent, in order."""
    return [(row.task, row.work_s, row.planning_s) for row in run.truth.executions if row.agent == agent]


@pytest.mark.parametrize("rise", [None, 0.1])
def test_without_a_human_in_the_way_the_robot_does_the_very_same_work_in_less_time(rise: float | None) -> None:
    pytest.importorskip("pybullet")
    free, watched = (
        simulate_run(small_scenario(cell, RED_AND_WHITE), SEED, 0, plan=small_plan(*RED_AND_WHITE), engine="bullet")
        for cell in (small_cell(), with_areas(small_cell(), ("left", (-1.0, 0.0), (0.7, 3.0), 0.25), rise=rise))
    )
    lost = [sum(row.lost_s or 0.0 for row in run.truth.executions if row.agent == ROBOT) for run in (free, watched)]
    assert lost[0] == pytest.approx(0.0, abs=1e-6)
    assert lost[1] > 0.5
    for agent in (ROBOT, HUMAN):
        assert len(works(free, agent)) == 4
        for one, other in zip(works(free, agent), works(watched, agent), strict=True):
            assert one[0] == other[0]
            assert one[1:] == pytest.approx(other[1:], abs=1e-6)
    assert all(pair.progress_s == pair.overlap_s for pair in free.truth.pairs)
    slowed = [pair for pair in watched.truth.pairs if pair.agent == ROBOT]
    if rise is None:
        assert sum(p.progress_s for p in slowed) == pytest.approx(sum(p.caused_progress_s for p in slowed), rel=0.05)
    else:  # what is lost while the override recovers is nobody's fault
        assert sum(p.progress_s for p in slowed) < 0.95 * sum(p.caused_progress_s for p in slowed)


# Stops that no human causes.


STOPS = {"protective_stop": {"rate_per_hour": 1200.0, "duration_s": 0.5}}


def test_a_protective_stop_halts_the_robot_for_its_time(stage: Callable[..., Stage]) -> None:
    on = stage(small_cell(STOPS))
    for task in ("pick_red", "put", "tour", "go_home"):
        on.do(ROBOT, task)
    told = [event for event in on.events if isinstance(event, SafetyStateChanged)]
    stops = [event for event in told if event.mode == "protective_stop"]
    assert stops
    assert {event.zone for event in stops} == {"protective_stop"}
    halts = [event for event in on.events if isinstance(event, TaskPaused | TaskResumed)]
    assert [type(halt) for halt in halts] == [TaskPaused, TaskResumed] * (len(halts) // 2)
    lost = sum(row.lost_s or 0.0 for row in on.cell.truth)
    first = [event.time_ns for event in stops if event.speed_scale == 0.0]
    assert lost >= 0.3 * len({time // 10**9 for time in first})


def test_stops_come_as_often_as_they_should(stage: Callable[..., Stage]) -> None:
    on = stage(small_cell({"protective_stop": {"rate_per_hour": 1800.0, "duration_s": 0.0}}))
    moved, told = 0.0, 0
    for _ in range(12):
        for task in ("step_aside", "go_home"):
            end = on.do(ROBOT, task)
            start = next(e for e in on.of(end) if isinstance(e, TaskStarted))
            moved += (end.time_ns - start.time_ns) / 1e9
    told = sum(
        before.mode == "normal" != after.mode
        for before, after in pairwise(e for e in on.events if isinstance(e, SafetyStateChanged))
    )
    expected = moved * 1800.0 / 3600.0
    assert expected > 8.0
    assert expected / 3 < told < 3 * expected


def test_nobody_is_blamed_for_a_protective_stop() -> None:
    pytest.importorskip("pybullet")
    scenario = small_scenario(small_cell(STOPS), RED_AND_WHITE)
    run = simulate_run(scenario, SEED, 0, plan=small_plan(*RED_AND_WHITE), engine="bullet")
    slowed = [pair for pair in run.truth.pairs if pair.agent == ROBOT]
    assert sum(pair.overlap_s - pair.progress_s for pair in slowed) > 0.3
    for pair in slowed:
        assert pair.caused_progress_s == pytest.approx(pair.overlap_s)


# What goes wrong is said.


def test_a_run_in_which_somebody_waits_for_ever_ends_with_a_word_about_it() -> None:
    pytest.importorskip("pybullet")
    cell = with_areas(small_cell({"longest_s": 20.0}), ("red", (-9.0, -9.0), (9.0, 9.0), 0.0))
    with pytest.raises(
        ScenarioError, match=r"not over after 20 s \(robot is at 'pick_red', .*\); somebody waits for ever"
    ):
        simulate_run(small_scenario(cell, RED_AND_WHITE), SEED, 0, plan=small_plan(*RED_AND_WHITE), engine="bullet")


def test_a_run_that_takes_longer_than_it_may_says_so() -> None:
    pytest.importorskip("pybullet")
    cell = small_cell({"longest_s": 5.0})
    with pytest.raises(ScenarioError, match="not over after 5 s"):
        simulate_run(small_scenario(cell, RED_AND_WHITE), SEED, 0, plan=small_plan(*RED_AND_WHITE), engine="bullet")


def test_a_moving_robot_that_touches_the_human_is_counted_and_told() -> None:
    pytest.importorskip("pybullet")
    cell = small_cell({"human.home": [1.0, 0.2, -90]})  # the human stands where the arm passes
    items = ((ROBOT, "pick_blue"), (ROBOT, "put"), (ROBOT, "pick_blue"), (ROBOT, "put"))
    run = simulate_run(small_scenario(cell, items), SEED, 0, plan=small_plan(*items), engine="bullet")
    seen = Recorded(run, cell)
    away = least_distances(seen.robot_body, seen.robot, seen.human_body, seen.human)
    touching = (away <= 0.0) & seen.moving
    assert touching.any(), "the example is none"
    notes = [event for event in run.events if isinstance(event, AnnotationAdded)]
    assert run.truth.contacts == len(notes) > 0
    assert {note.agent for note in notes} == {"robot"}
    assert all("touch" in note.reason and "human" in note.reason for note in notes)
    begins = np.flatnonzero(touching & ~np.append([False], (away <= 0.0)[:-1]))
    instants = {seen.start_ns + int(number) * LOOK_NS for number in begins}
    assert instants <= {note.time_ns for note in notes}


def test_a_scenario_without_a_cell_cannot_be_stepped(paper: Scenario) -> None:
    bare = replace(paper, cell=None)
    for ask in (cell_of, lambda scenario: with_policy(scenario, "ssm")):
        with pytest.raises(ScenarioError, match=r"scenario 'paper': it has no cell, .* choose --engine events"):
            ask(bare)


def test_what_is_out_of_reach_is_named_before_the_run_begins() -> None:
    pytest.importorskip("pybullet")
    far = small_cell({"objects.0.positions": [[0.7, -2.0, 1.03]]})
    with pytest.raises(ScenarioError, match=r"'red_1' at .* is out of the robot's reach"):
        simulate_run(small_scenario(far, RED_AND_WHITE), SEED, 0, plan=small_plan(*RED_AND_WHITE), engine="bullet")
    high = small_cell({"objects.2.positions": [[1.84, 1.25, 2.9]]})
    with pytest.raises(ScenarioError, match=r"'white_1': .* cannot reach"):
        simulate_run(small_scenario(high, RED_AND_WHITE), SEED, 0, plan=small_plan(*RED_AND_WHITE), engine="bullet")


# The same arguments give the same run.


def test_the_same_arguments_give_the_same_bytes_again_and_in_another_process(tmp_path: Path) -> None:
    pytest.importorskip("pybullet")
    for name in ("here", "there"):
        (tmp_path / name).mkdir()
    here = digests_of_small_runs([0, 1], str(tmp_path / "here"))
    assert digest(small_run(SEED, 0), tmp_path / "again.mcap") == here[0]
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        there = pool.submit(digests_of_small_runs, [1, 0], str(tmp_path / "there")).result()
    assert here == there[::-1]


def test_runs_differ_by_seed_and_number() -> None:
    pytest.importorskip("pybullet")
    runs = [small_run(*key) for key in ((1, 0), (1, 1), (2, 0))]
    assert len({tuple(row.work_s for row in run.truth.executions) for run in runs}) == 3
    assert len({run.truth.run_id for run in runs}) == 3


def test_sampling_less_often_changes_nothing_but_the_signals() -> None:
    pytest.importorskip("pybullet")
    runs = {}
    for rate in (50.0, 10.0, 0.0):
        cell = with_areas(small_cell({"signals_hz": rate}), ("left", (-1.0, 0.0), (0.7, 3.0), 0.25))
        runs[rate] = simulate_run(
            small_scenario(cell, RED_AND_WHITE), SEED, 0, plan=small_plan(*RED_AND_WHITE), engine="bullet"
        )
    told = [[(e.kind, e.time_ns, getattr(e, "task", "")) for e in run.events] for run in runs.values()]
    assert told[0] == told[1] == told[2]
    work = [[(row.work_s, row.lost_s) for row in run.truth.executions] for run in runs.values()]
    assert work[0] == work[1] == work[2]
    assert runs[0.0].signals == ()
    times = [one.time_ns for one in runs[10.0].signals if isinstance(one, JointSignal) and one.agent == ROBOT]
    assert min(after - before for before, after in pairwise(times)) >= 100_000_000
    assert (
        len(times) < len([one for one in runs[50.0].signals if isinstance(one, JointSignal) and one.agent == ROBOT]) / 4
    )


def test_policies_share_the_chances_of_the_human(bullet_runs: BulletRuns) -> None:
    firsts = {
        next((row.task, row.work_s) for row in bullet_runs(policy, 0).truth.executions if row.agent == "human")
        for policy in POLICIES
    }
    assert len(firsts) == 1


# A campaign.


@pytest.mark.slow
@EACH_POLICY
def test_many_runs_are_sound(paper: Scenario, policy: str) -> None:
    pytest.importorskip("pybullet")
    scenario = with_policy(paper, policy)
    failed: Mapping[int, str] = {}
    for index in range(many(3, fuzz=50)):
        run = simulate_run(scenario, SEED, index, engine="bullet")
        try:
            everything_is_done(run)
            time_adds_up(run)
            overlaps_are_those_of_the_log(run)
            objects_end_where_the_log_says(run, cell_of(scenario))
            seen = Recorded(run, cell_of(scenario))
            motions_are_possible(seen, step=2)
            distances_are_right(seen, step=2)
            if policy in GUARDED:
                nobody_is_touched(seen)
        except AssertionError as error:
            failed = {**failed, index: str(error)[:300]}
    assert not failed
