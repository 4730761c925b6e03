"""The parameters of the safety policies. Data; what the policies make of them is in `hrclog.sim.bullet.safety`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

AREAS: Final = "areas"
DISTANCE: Final = "distance"
SSM: Final = "ssm"

DECELERATION: Final = 2.5
"""Of the robot's brakes, m/s^2, where a cell says nothing else."""


@dataclass(frozen=True, slots=True)
class Area:
    """A rectangle of the floor, m, and the largest speed scale while a part of the human is in it.

    `guarded` is the rectangle (low, high) that the gripper must be in for the area to act: elsewhere it is muted, as
    behind the robot's own rail. None acts everywhere.
    """

    name: str
    low: tuple[float, float]
    high: tuple[float, float]
    scale: float
    guarded: tuple[tuple[float, float], tuple[float, float]] | None = None


@dataclass(frozen=True, slots=True)
class Band:
    """The largest speed scale while human and robot are nearer than a distance in m."""

    nearer_than_m: float
    scale: float


@dataclass(frozen=True, slots=True)
class Slew:
    """How fast the override may fall and recover, share of full speed per second; None: as the robot's brakes allow."""

    fall_per_s: float | None = None
    rise_per_s: float | None = None


@dataclass(frozen=True, slots=True)
class AreasSettings:
    """Fixed areas, worst wins; anywhere else is free. Braking deceleration in m/s^2."""

    areas: tuple[Area, ...] = ()
    slew: Slew = Slew()
    deceleration: float = DECELERATION

    @property
    def braking(self) -> float:
        """Return the deceleration of the robot's brakes, m/s^2."""
        return self.deceleration


@dataclass(frozen=True, slots=True)
class DistanceSettings:
    """Bands of the smallest distance between human and robot, nearest first. Braking deceleration in m/s^2."""

    bands: tuple[Band, ...] = (Band(0.7, 0.0), Band(1.1, 0.5))
    slew: Slew = Slew()
    deceleration: float = DECELERATION

    @property
    def braking(self) -> float:
        """Return the deceleration of the robot's brakes, m/s^2."""
        return self.deceleration


@dataclass(frozen=True, slots=True)
class SsmSettings:
    """Speed and separation: human speed (m/s), reaction time (s), deceleration (m/s^2), clearance (m).

    `deceleration` is what the formula reckons with; `brakes` is what the robot does, never less.
    """

    human_speed: float = 1.6
    reaction_s: float = 0.15
    deceleration: float = DECELERATION
    clearance_m: float = 0.2
    brakes: float = DECELERATION
    slew: Slew = Slew()

    @property
    def braking(self) -> float:
        """Return the deceleration of the robot's brakes, m/s^2."""
        return max(self.brakes, self.deceleration)


@dataclass(frozen=True, slots=True)
class SafetySettings:
    """The parameters of all policies, and the one that holds unless another is chosen."""

    policy: str = AREAS
    areas: AreasSettings = AreasSettings()
    distance: DistanceSettings = DistanceSettings()
    ssm: SsmSettings = SsmSettings()


@dataclass(frozen=True, slots=True)
class PolicyRecord:
    """A safety policy: its settings are the field of its name in `SafetySettings`.

    Attributes:
        name: by which it is chosen.
        summary: its rule.
    """

    name: str
    summary: str


POLICIES: Final = {
    record.name: record
    for record in (
        PolicyRecord(AREAS, "rectangles of the floor; the smallest scale of all that hold a part of the human"),
        PolicyRecord(DISTANCE, "bands of the smallest distance between human and robot"),
        PolicyRecord(
            SSM,
            "speed and separation: scale = min over pairs of body parts of v_max(d) / speed towards the human; what "
            "recedes is free",
        ),
    )
}
"""By name; the first is the default."""
