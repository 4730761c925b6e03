"""Motions along fixed paths in joint space under a synchronised trapezoidal time law."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Final

import numpy as np

from hrclog.arrays import FloatArray
from hrclog.sim.cell.robot_kinematics import RailArm

Limits = Sequence[float] | FloatArray

_SAMPLES_PER_S: Final = 100
_NEGLIGIBLE_S: Final = 1e-12
"""Moves that would take less at the greatest speed take no time."""


@dataclass(frozen=True, eq=False)
class Segment:
    """A straight line in joint space: q = start + s(t) (end - start), where s speeds up, cruises and slows down.

    Before its begin it stands at the start, after its end at the end.

    Args:
        start: joint positions, shape (n,).
        end: joint positions, shape (n,).
        ramp_s: how long s speeds up, and how long it slows down.
        duration_s: of the whole.
        peak: the greatest speed of s, in 1/s.
    """

    start: FloatArray
    end: FloatArray
    ramp_s: float
    duration_s: float
    peak: float

    def at(self, t: float) -> FloatArray:
        """Return the joint positions at a time in s, shape (n,)."""
        if t >= self.duration_s:
            return self.end.copy()
        if t <= 0.0:
            return self.start.copy()
        left = self.duration_s - t
        if t <= left:  # from the nearer end: symmetric to the last bit, and no step where the ends are met
            return self.start + self._progress(t) * (self.end - self.start)
        return self.end + self._progress(left) * (self.start - self.end)

    def velocity(self, t: float) -> FloatArray:
        """Return the joint velocities at a time in s, shape (n,)."""
        to_end = min(t, self.duration_s - t)
        if to_end <= 0.0:
            return np.zeros_like(self.start)
        speed = self.peak if to_end >= self.ramp_s else self.peak * to_end / self.ramp_s
        return speed * (self.end - self.start)

    def _progress(self, t: float) -> float:
        """Return s in the first half."""
        if t < self.ramp_s:
            return self.peak * t * t / (2 * self.ramp_s)
        return self.peak * (t - self.ramp_s / 2)


@dataclass(frozen=True, eq=False)
class Dwell:
    """Standing still.

    Args:
        start: joint positions, shape (n,).
        duration_s: for how long.
    """

    start: FloatArray
    duration_s: float

    @property
    def end(self) -> FloatArray:
        """The joint positions, shape (n,)."""
        return self.start

    def at(self, t: float) -> FloatArray:  # noqa: ARG002 - as Segment.at
        """Return the joint positions, shape (n,)."""
        return self.start.copy()

    def velocity(self, t: float) -> FloatArray:  # noqa: ARG002 - as Segment.velocity
        """Return zeros, shape (n,)."""
        return np.zeros_like(self.start)


class Path:
    """Segments and dwells one after the other.

    Args:
        parts: at least one; each starts where the one before ends.
    """

    def __init__(self, parts: Sequence[Segment | Dwell]) -> None:
        if not parts:
            raise ValueError("a path has at least one part")
        self.parts = tuple(parts)
        self._begins = [0.0, *accumulate(part.duration_s for part in self.parts)]
        self.duration_s = self._begins.pop()

    @property
    def start(self) -> FloatArray:
        """The joint positions at the begin, shape (n,)."""
        return self.parts[0].start

    @property
    def end(self) -> FloatArray:
        """The joint positions at the end, shape (n,)."""
        return self.parts[-1].end

    def at(self, t: float) -> FloatArray:
        """Return the joint positions at a time in s, shape (n,); the nearer end outside."""
        part, part_time = self._part_at(t)
        return part.at(part_time)

    def velocity(self, t: float) -> FloatArray:
        """Return the joint velocities at a time in s, shape (n,); zero outside."""
        part, part_time = self._part_at(t)
        return part.velocity(part_time)

    def length_m(self, arm: RailArm) -> float:
        """Return how far the tip of an arm travels, in m, from samples 10 ms apart or closer."""
        tips = [arm.forward(_samples(part))[:, :3, 3] for part in self.parts if isinstance(part, Segment)]
        return float(sum(np.linalg.norm(np.diff(tip, axis=0), axis=1).sum() for tip in tips))

    def _part_at(self, t: float) -> tuple[Segment | Dwell, float]:
        number = max(bisect_right(self._begins, t) - 1, 0)
        return self.parts[number], t - self._begins[number]


def trapezoid(q_from: FloatArray, q_to: FloatArray, max_velocity: Limits, max_acceleration: Limits) -> Segment:
    """Return the fastest synchronised motion from one rest to another.

    All joints share one profile s(t), whose speed and acceleration are the greatest that no joint's limits forbid. So
    the slowest joint sets the duration; it takes no longer than alone unless one joint limits the speed and another
    the acceleration.

    Args:
        q_from: joint positions, shape (n,).
        q_to: joint positions, shape (n,).
        max_velocity: of each joint, n positive numbers.
        max_acceleration: of each joint, n positive numbers.
    """
    start, end = np.array(q_from, dtype=np.float64), np.array(q_to, dtype=np.float64)
    travel = np.abs(end - start)
    by_speed = float(np.max(travel / np.asarray(max_velocity)))  # s at the greatest speed
    by_acceleration = float(np.max(travel / np.asarray(max_acceleration)))  # s^2
    if by_speed < _NEGLIGIBLE_S:
        return Segment(start, end, 0.0, 0.0, 0.0)
    ramp_s = by_acceleration / by_speed
    if ramp_s < by_speed:
        return Segment(start, end, ramp_s, by_speed + ramp_s, 1.0 / by_speed)
    ramp_s = math.sqrt(by_acceleration)
    return Segment(start, end, ramp_s, 2 * ramp_s, 1.0 / ramp_s)


def path_through(waypoints: Sequence[FloatArray], max_velocity: Limits, max_acceleration: Limits) -> Path:
    """Return a path that comes to rest at every waypoint.

    Args:
        waypoints: joint positions, at least one, each of shape (n,).
        max_velocity: see `trapezoid`.
        max_acceleration: see `trapezoid`.
    """
    legs = [trapezoid(start, end, max_velocity, max_acceleration) for start, end in pairwise(waypoints)]
    return Path(legs or [Dwell(waypoint, 0.0) for waypoint in waypoints[:1]])


def _samples(segment: Segment) -> FloatArray:
    count = math.ceil(segment.duration_s * _SAMPLES_PER_S) + 1
    return np.stack([segment.at(t) for t in np.linspace(0.0, segment.duration_s, count).tolist()])
