"""The stepped cell: robot and human in PyBullet, guarded by a safety policy, in ticks of simulated time.

The simulation has kinematics only: bodies are moved, not pushed. Every tick the robot moves along its path as fast as
the override allows. Every other tick the policy checks where the robot and the human are.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import Final

import numpy as np

from hrclog.arrays import FloatArray
from hrclog.errors import ScenarioError
from hrclog.events import AnnotationAdded, SafetyStateChanged
from hrclog.ids import Uuid7Generator
from hrclog.log.messages.encode import Signal
from hrclog.recorders.clock import Clock
from hrclog.recorders.executors.protocol import Emit, Executor
from hrclog.sim.bullet import human
from hrclog.sim.bullet.cell_signals import CellSignals
from hrclog.sim.bullet.couplings import Couplings, Going
from hrclog.sim.bullet.executors import HumanExecutor, RobotExecutor
from hrclog.sim.bullet.robot import RobotPlanner, check_reach, make_arm
from hrclog.sim.bullet.safety import Limit, Override, make_policy
from hrclog.sim.bullet.stepped import TICK, TICK_NS, TICK_S, Shared
from hrclog.sim.bullet.stock import Stock
from hrclog.sim.bullet.world import Separation, World
from hrclog.sim.cell.description import LOOKS_HZ, Cell, Point, check_policy
from hrclog.sim.cell.human_kinematics import human_points
from hrclog.sim.cell.robot_kinematics import RailArm
from hrclog.sim.cell.safety_settings import AREAS
from hrclog.sim.scenario import Scenario
from hrclog.sim.stream import Stream
from hrclog.sim.truth import ExecutionTruth, PairTruth
from hrclog.units import NS_PER_S

_LOOK_EVERY: Final = 2
_SCALE_CHANGE: Final = 0.1
"""A safety event is emitted when the speed scale has changed by this much, or the mode has changed."""
_DIGITS: Final = 6


class BulletCell:
    """A cell for one run, with an executor for the robot and one for the human.

    Args:
        scenario: with a cell.
        clock: simulated.
        seed: of the campaign.
        index: number of the run in the campaign.

    Raises:
        ScenarioError: the scenario has no cell, something in it is out of reach, or PyBullet is not installed.
    """

    name: Final = "bullet"

    def __init__(self, scenario: Scenario, clock: Clock, seed: int, index: int) -> None:
        cell = cell_of(scenario)
        _check_reach(cell)
        self.contacts = 0
        self.truth: list[ExecutionTruth] = []
        self._cell = cell
        self._clock = clock
        self._world = World(cell)
        self._arm = make_arm(cell.robot)
        self._stock = Stock(cell)
        stream = {name: Stream(seed, index, "cell", name) for name in ("robot", "human", "paths", "ids", "stops")}
        new_id = Uuid7Generator(lambda: clock.now_ns, stream["ids"].bits)
        planner = RobotPlanner(cell.robot, self._arm, self._world.free, stream["paths"])
        shared = Shared(scenario, cell, clock, self._stock, new_id, self._wake, self.truth)
        self._robot = RobotExecutor(planner, shared, stream["robot"])
        self._human = HumanExecutor(self._robot_tip, shared, stream["human"])
        self._policy, slew, deceleration = make_policy(cell.safety.policy, cell.safety)
        self._override = Override(slew, deceleration)
        self._couplings = Couplings()
        self._samples = CellSignals(cell)
        self._stops = stream["stops"]
        self._stop_left = 0
        self._emit: Emit = lambda _: None
        self._start_ns = clock.now_ns
        self._ticking = self._touching = self._stopped = False
        self._n_looks = 0
        self._sample_every = round(LOOKS_HZ / cell.signals_hz) if cell.signals_hz else 0
        self._limit = Limit(1.0)
        self._mode, self._emitted_scale = "", -1.0
        self._tip_speed = 0.0

    @cached_property
    def executors(self) -> dict[str, Executor]:
        """The robot's and the human's."""
        return {
            self._cell.robot.agent: _WithCellEvents(self._robot, self._set_emit),
            self._cell.human.agent: self._human,
        }

    @property
    def pairs(self) -> tuple[PairTruth, ...]:
        """What tasks did to each other so far."""
        return self._couplings.pairs()

    @property
    def signals(self) -> list[Signal]:
        """The samples so far, in order of time."""
        return self._samples.samples

    def watch(self) -> None:
        """Begin: look round, and say the first safety state."""
        if self._sample_every:
            self._samples.scene(self._clock.now_ns)
        self._check_safety()
        self._emit_safety_state(self._override.scale)

    def stop(self) -> None:
        """End: nothing moves any more."""
        self._stopped = True
        self._world.close()

    def _set_emit(self, emit: Emit) -> None:
        self._emit = emit

    def _wake(self) -> None:
        """Restart the ticks, at whole ticks from the start of the run."""
        if not self._ticking:
            self._ticking = True
            ticks = (self._clock.now_ns - self._start_ns) // TICK_NS + 1
            self._clock.schedule(self._start_ns + ticks * TICK_NS, self._tick, TICK)

    def _tick(self) -> None:
        if self._stopped:
            return
        now_ns = self._clock.now_ns
        if now_ns - self._start_ns > self._cell.longest_s * NS_PER_S:
            self._world.close()
            activities = self._describe_activities()
            raise ScenarioError(
                f"cell: the run is not over after {self._cell.longest_s:g} s ({activities}); somebody waits for"
                " ever, or longest_s is too small"
            )
        if (now_ns - self._start_ns) // TICK_NS % _LOOK_EVERY == 0:
            self._check_safety()
        limit = self._limit_or_stop(self._limit)
        scale = self._override.advance(limit.scale, self._tip_speed, TICK_S)
        self._emit_safety_state(scale)
        rate = self._human.rate()
        self._count_couplings(scale, self._limit.scale, rate)
        self._robot.step(scale)
        self._human.step(rate)
        self._human.idle()
        self._schedule_tick(now_ns + TICK_NS)

    def _describe_activities(self) -> str:
        """Describe what each agent is doing, for the error message of a run that does not end."""
        activities = [
            f"{executor.agents[0]} is at {executor.running.command.task!r}"
            if executor.running
            else f"{executor.agents[0]} has nothing to do"
            for executor in (self._robot, self._human)
        ]
        return ", ".join([*activities, f"speed scale {self._override.scale:.2g} {self._limit.zone}".rstrip()])

    def _schedule_tick(self, next_ns: int) -> None:
        """Schedule the next tick while an agent has something to do."""
        self._ticking = not self._stopped and (self._robot.busy or self._human.busy or not self._human.at_home)
        if self._ticking:
            self._clock.schedule(next_ns, self._tick, TICK)

    def _check_safety(self) -> None:
        now_ns = self._clock.now_ns
        view = _View(self._world, self._arm, self._robot.joints(), self._human.joints(), self._robot.velocity())
        self._limit = self._policy(view)
        brakes = self._limit.scale != self._override.scale or self._cell.protective_stop.rate_per_hour > 0.0
        self._tip_speed = view.fastest() if brakes else 0.0
        self._count_contact(view)
        if self._sample_every and self._n_looks % self._sample_every == 0:
            self._sample(now_ns, view)
        self._n_looks += 1

    def _sample(self, now_ns: int, view: _View) -> None:
        robot = self._cell.robot.agent
        self._samples.joints(now_ns, view.robot, view.human)
        self._samples.number(now_ns, f"{robot}/min_distance", round(view.distance_m, _DIGITS))
        self._samples.number(now_ns, f"{robot}/speed_scale", round(self._override.scale, _DIGITS))
        for item in self._stock.items.values():
            if item.held:
                by_robot = item.agent == robot
                hand = self._arm.forward(view.robot)[:3, 3] if by_robot else human.hand_position(view.human)
                item.position, item.yaw = _point(hand), 0.0 if by_robot else float(view.human[2])
            if item.held or item.slot is not None:
                self._samples.pose(now_ns, item.box.name, item.position, item.yaw)

    def _count_contact(self, view: _View) -> None:
        """Count each time that the moving robot comes to touch the human."""
        touching = view.distance_m <= 0.0
        moving = view.velocity is not None and self._override.scale > 0.0
        if touching and moving and not self._touching:
            self.contacts += 1
            self._emit(
                AnnotationAdded(
                    time_ns=self._clock.now_ns,
                    agent=self._cell.robot.agent,
                    reason="the moving robot touched the human",
                )
            )
        self._touching = touching and (moving or self._touching)

    def _limit_or_stop(self, limit: Limit) -> Limit:
        """Return the limit, or that of a protective stop."""
        if self._stop_left:
            self._stop_left -= 1
            return Limit(0.0, _PROTECTIVE)
        rate = self._cell.protective_stop.rate_per_hour
        if rate and self._robot.moving and self._stops.uniform() < rate * TICK_S / 3600.0:
            self._stop_left = round(self._cell.protective_stop.duration_s / TICK_S)
            return Limit(0.0, _PROTECTIVE)
        return limit

    def _emit_safety_state(self, scale: float) -> None:
        mode = _mode(scale, stopped_by_fault=self._stop_left > 0)
        if mode == self._mode and abs(scale - self._emitted_scale) < _SCALE_CHANGE:
            return
        self._mode, self._emitted_scale = mode, scale
        self._emit(
            SafetyStateChanged(
                time_ns=self._clock.now_ns,
                agent=self._cell.robot.agent,
                mode=mode,
                speed_scale=round(scale, _DIGITS),
                zone=_PROTECTIVE if mode == _PROTECTIVE else self._limit.zone,
            )
        )

    def _count_couplings(self, scale: float, caused: float, rate: float) -> None:
        going = {}
        for executor, own_rate, caused_rate in ((self._robot, scale, caused), (self._human, rate, rate)):
            execution = executor.running
            if execution is not None:
                key = execution.command.agent, execution.command.task
                free = not executor.moving
                going[key[0]] = Going(key, 1.0 if free else own_rate, 1.0 if free else caused_rate)
        self._couplings.count(going)

    def _robot_tip(self) -> FloatArray:
        return np.asarray(self._arm.forward(self._robot.joints())[:3, 3])


_PROTECTIVE: Final = "protective_stop"


class _WithCellEvents:
    """An executor whose cell emits events too: safety states belong to no command."""

    def __init__(self, executor: Executor, listen: Callable[[Emit], None]) -> None:
        self._executor = executor
        self._set_emit = listen
        self.agents = executor.agents
        self.start = executor.start
        self.cancel = executor.cancel

    def connect(self, emit: Emit) -> None:
        """Send all events to `emit` from now on."""
        self._set_emit(emit)
        self._executor.connect(emit)


class _View:
    """What the policy sees at an instant. Expensive values are computed on demand."""

    def __init__(
        self, world: World, arm: RailArm, robot: FloatArray, people: FloatArray, velocity: FloatArray | None
    ) -> None:
        self.robot = robot
        self.human = people
        self.velocity = velocity
        self._arm = arm
        world.set_robot(robot)
        world.set_human(people)
        self._separation: Separation = world.separation()

    @property
    def human_points(self) -> list[tuple[float, float, float]]:
        """Points of the human's body, m."""
        return [_point(point) for point in human_points(self.human)]

    @property
    def gripper(self) -> Point:
        """Where the gripper's tip is, m."""
        return _point(self._frames[7, :3, 3])

    @property
    def distance_m(self) -> float:
        """Smallest distance between human and robot, m."""
        return self._separation.least_m

    @cached_property
    def _frames(self) -> FloatArray:
        return self._arm.frames(self.robot)

    def closing(self) -> tuple[FloatArray, FloatArray]:
        """Return per pair of body parts the distance (m) and the robot's speed towards the human (m/s) at scale 1."""
        separation = self._separation
        if self.velocity is None:
            return separation.distances, np.zeros(len(separation.distances))
        moves = self._arm.point_velocity(self._frames, self.velocity, separation.robot_links, separation.on_robot)
        towards = separation.on_human - separation.on_robot
        lengths = np.maximum(np.linalg.norm(towards, axis=1), 1e-9)
        # inside each other the line between the nearest points is turned round
        sign = np.where(separation.distances < 0.0, -1.0, 1.0)
        return separation.distances, sign * (moves * towards).sum(axis=1) / lengths

    def fastest(self) -> float:
        """Return the speed of the robot's fastest joint or tip at scale 1, m/s."""
        if self.velocity is None:
            return 0.0
        links = np.arange(8)
        moves = self._arm.point_velocity(self._frames, self.velocity, links, self._frames[:, :3, 3])
        return math.sqrt(float((moves**2).sum(axis=1).max()))


@lru_cache(maxsize=64)
def _check_reach(cell: Cell) -> None:
    """Raise, once for all runs of a cell, if something is out of the robot's or the human's reach."""
    world = World(cell)
    try:
        check_reach(cell, RobotPlanner(cell.robot, make_arm(cell.robot), world.free, Stream(0, "reach")))
    finally:
        world.close()
    human.check_reach(cell)


def cell_of(scenario: Scenario) -> Cell:
    """Return the cell of a scenario.

    Raises:
        ScenarioError: it has none.
    """
    if scenario.cell is None:
        raise ScenarioError(
            f"scenario {scenario.name!r}: it has no cell, which the engine 'bullet' needs; add one or choose --engine"
            " events"
        )
    return scenario.cell


def with_policy(scenario: Scenario, policy: str) -> Scenario:
    """Return a scenario guarded by another safety policy.

    Raises:
        ScenarioError: it has no cell, there is no such policy, or the cell has no areas for it.
    """
    cell = cell_of(scenario)
    check_policy(policy)
    if policy == AREAS and not cell.safety.areas.areas:
        raise ScenarioError(f"scenario {scenario.name!r}: its cell has no areas; add some or choose another policy")
    return replace(scenario, cell=replace(cell, safety=replace(cell.safety, policy=policy)))


def with_signals(scenario: Scenario, signals_hz: float) -> Scenario:
    """Return a scenario whose signals are sampled at another rate, at most 50 Hz; 0 for none.

    Raises:
        ScenarioError: it has no cell.
    """
    return replace(scenario, cell=replace(cell_of(scenario), signals_hz=signals_hz))


def _mode(scale: float, *, stopped_by_fault: bool) -> str:
    if stopped_by_fault:
        return _PROTECTIVE
    return "stopped" if scale == 0.0 else "reduced" if scale < 1.0 else "normal"


def _point(values: FloatArray) -> Point:
    x, y, z = values.tolist()
    return x, y, z
