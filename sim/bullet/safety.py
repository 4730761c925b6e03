"""Safety policies: how fast the robot may go, given where the human is. A simulation, never a safety function.

Each policy returns a speed scale in [0, 1]. `Override` is the scale of the robot, which follows with brakes that need
time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from hrclog.arrays import FloatArray
from hrclog.sim.cell.safety_settings import (
    AREAS,
    DISTANCE,
    SSM,
    AreasSettings,
    DistanceSettings,
    SafetySettings,
    Slew,
    SsmSettings,
)

_STILL_M_S: Final = 1e-3
"""Links that come nearer more slowly than this are taken to stand."""


class View(Protocol):
    """What a policy may look at."""

    @property
    def human_points(self) -> list[tuple[float, float, float]]:
        """Points of the human's body, m."""
        ...

    @property
    def gripper(self) -> tuple[float, float, float]:
        """Where the gripper's tip is, m."""
        ...

    @property
    def distance_m(self) -> float:
        """Smallest distance between human and robot, m."""
        ...

    def closing(self) -> tuple[FloatArray, FloatArray]:
        """Return per pair of body parts the distance (m) and the robot's speed towards the human (m/s) at scale 1."""
        ...


@dataclass(frozen=True, slots=True)
class Limit:
    """The largest speed scale allowed, and the area or rule that asks for it ("" where nothing does)."""

    scale: float
    zone: str = ""


Policy = Callable[[View], Limit]
FREE: Final = Limit(1.0)


def make_policy(name: str, settings: SafetySettings) -> tuple[Policy, Slew, float]:
    """Return a policy by its name, its slew, and the deceleration (m/s^2) of its brakes."""
    make = _MAKERS[name]
    policy_settings = getattr(settings, name)
    return make(policy_settings), policy_settings.slew, policy_settings.braking


def areas_policy(settings: AreasSettings) -> Policy:
    """Return the policy of fixed areas: the smallest scale of all areas that hold a point of the human."""
    areas = sorted(settings.areas, key=lambda area: (area.scale, area.name))

    def limit(view: View) -> Limit:
        points = view.human_points
        for area in areas:
            muted = area.guarded is not None and not _is_inside(view.gripper, *area.guarded)
            if not muted and any(_is_inside(point, area.low, area.high) for point in points):
                return Limit(area.scale, area.name)
        return FREE

    return limit


def _is_inside(point: tuple[float, float, float], low: tuple[float, float], high: tuple[float, float]) -> bool:
    return low[0] <= point[0] <= high[0] and low[1] <= point[1] <= high[1]


def distance_policy(settings: DistanceSettings) -> Policy:
    """Return the policy of distance bands: the scale of the nearest band that the human is in."""
    bands = sorted(settings.bands, key=lambda band: band.nearer_than_m)

    def limit(view: View) -> Limit:
        distance = view.distance_m
        for band in bands:
            if distance < band.nearer_than_m:
                return Limit(band.scale, f"nearer than {band.nearer_than_m:g} m")
        return FREE

    return limit


def allowed_speed(distance_m: FloatArray | float, settings: SsmSettings) -> FloatArray:
    """Return how fast (m/s) the robot may come towards a human at a distance.

    v_max(d) = max(0, sqrt(v_h^2 + (a T_r)^2 + 2 a (d - C)) - a T_r - v_h), 0 for d <= C: Marvel and Norcross,
    Implementing speed and separation monitoring in collaborative robot workcells (2017), after ISO/TS 15066.

    Args:
        distance_m: any shape.
        settings: v_h, T_r, a and C.
    """
    gap = np.asarray(distance_m, dtype=np.float64) - settings.clearance_m
    lost_speed = settings.deceleration * settings.reaction_s
    root = np.sqrt(settings.human_speed**2 + lost_speed**2 + 2 * settings.deceleration * np.maximum(gap, 0.0))
    return np.asarray(np.where(gap > 0.0, np.maximum(root - lost_speed - settings.human_speed, 0.0), 0.0))


def ssm_policy(settings: SsmSettings) -> Policy:
    """Return the policy of speed and separation: the smallest v_max / speed of all parts that come nearer."""

    def limit(view: View) -> Limit:
        distances, speeds = view.closing()
        nearer = speeds > _STILL_M_S
        if not nearer.any():
            return FREE
        scale = float((allowed_speed(distances[nearer], settings) / speeds[nearer]).min())
        return FREE if scale >= 1.0 else Limit(scale, "separation")

    return limit


class Override:
    """The speed scale that the robot has: it follows the limit as fast as slew and brakes let it.

    Args:
        slew: rates of the override itself.
        deceleration: of the brakes, m/s^2; it bounds how fast the scale can change at a given speed of the robot.
    """

    def __init__(self, slew: Slew, deceleration: float) -> None:
        self.scale = 1.0
        self._slew = slew
        self._deceleration = deceleration

    def advance(self, limit: float, speed_m_s: float, dt_s: float) -> float:
        """Move the scale towards a limit for a time and return it.

        Args:
            limit: what the policy allows.
            speed_m_s: of the robot's fastest point at scale 1; a robot that stands can change its scale at once.
            dt_s: how long.
        """
        brakes = self._deceleration / speed_m_s if speed_m_s > 0.0 else math.inf
        if limit < self.scale:
            rate = min(brakes, self._slew.fall_per_s or math.inf)
            self.scale = max(limit, self.scale - rate * dt_s)
        else:
            rate = min(brakes, self._slew.rise_per_s or math.inf)
            self.scale = min(limit, self.scale + rate * dt_s)
        return self.scale


_MAKERS: Final[Mapping[str, Callable[..., Policy]]] = {
    AREAS: areas_policy,
    DISTANCE: distance_policy,
    SSM: ssm_policy,
}
"""What makes a policy of its settings, by the names of `POLICIES`."""
