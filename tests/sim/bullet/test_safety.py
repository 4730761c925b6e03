"""Safety policies at their boundaries, and the brakes that obey them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from hrclog.arrays import FloatArray
from hrclog.sim.bullet.safety import (
    FREE,
    Limit,
    Override,
    allowed_speed,
    areas_policy,
    distance_policy,
    make_policy,
    ssm_policy,
)
from hrclog.sim.cell.safety_settings import (
    POLICIES,
    Area,
    AreasSettings,
    Band,
    DistanceSettings,
    SafetySettings,
    Slew,
    SsmSettings,
)

SIMULATOR = SsmSettings(human_speed=0.0, reaction_s=1.0, deceleration=0.1, clearance_m=0.2)
REAL_CELL = SsmSettings(human_speed=1.6, reaction_s=0.3, deceleration=1.0, clearance_m=0.3)
NN_SSM = SsmSettings(human_speed=1.6, reaction_s=0.15, deceleration=2.5, clearance_m=0.2)
SETS = (SIMULATOR, REAL_CELL, NN_SSM)

RED = Area("red", (0.0, 0.0), (1.0, 2.0), 0.0)
ORANGE = Area("orange", (-1.0, -1.0), (3.0, 3.0), 0.5)

settings_of_ssm = st.builds(
    SsmSettings, st.floats(0.0, 3.0), st.floats(0.0, 1.0), st.floats(0.1, 10.0), st.floats(0.0, 1.0)
)
scales = st.floats(0.0, 1.0)


@dataclass
class Seen:
    """What a policy sees."""

    human_points: list[tuple[float, float, float]] = field(default_factory=list)
    distance_m: float = 9.0
    gripper: tuple[float, float, float] = (0.0, 0.0, 1.0)
    distances: tuple[float, ...] = ()
    speeds: tuple[float, ...] = ()

    def closing(self) -> tuple[FloatArray, FloatArray]:
        """Return distances and speeds."""
        return np.array(self.distances), np.array(self.speeds)


def standing_at(*points: tuple[float, float]) -> Seen:
    """Return a human whose body points are above points of the floor."""
    return Seen(human_points=[(x, y, 1.0 + 0.1 * number) for number, (x, y) in enumerate(points)])


@pytest.mark.parametrize("corner", [(0.0, 0.0), (1.0, 2.0), (0.0, 2.0), (1.0, 0.0), (0.5, 0.0), (1.0, 1.0)])
def test_the_edges_of_an_area_belong_to_it(corner: tuple[float, float]) -> None:
    policy = areas_policy(AreasSettings((RED,)))
    assert policy(standing_at(corner)) == Limit(0.0, "red")
    x, y = corner
    beyond = (math.nextafter(x, -9.0 if x == 0.0 else 9.0), y), (x, math.nextafter(y, -9.0 if y == 0.0 else 9.0))
    outside = [point for point in beyond if not (0.0 <= point[0] <= 1.0 and 0.0 <= point[1] <= 2.0)]
    assert outside
    assert all(policy(standing_at(point)) == FREE for point in outside)


@pytest.mark.parametrize("areas", [(RED, ORANGE), (ORANGE, RED)])
def test_the_worst_area_that_any_point_of_the_body_is_in_wins(areas: tuple[Area, ...]) -> None:
    policy = areas_policy(AreasSettings(areas))
    assert policy(standing_at((2.5, 2.5), (9.0, 9.0))) == Limit(0.5, "orange")
    assert policy(standing_at((2.5, 2.5), (0.5, 0.5))) == Limit(0.0, "red")
    assert policy(standing_at((0.5, 0.5))) == Limit(0.0, "red")
    assert policy(standing_at((9.0, 9.0))) == FREE
    assert policy(Seen()) == FREE


def test_an_area_reaches_to_any_height() -> None:
    policy = areas_policy(AreasSettings((RED,)))
    for height in (-1.0, 0.0, 5.0):
        assert policy(Seen(human_points=[(0.5, 0.5, height)])).scale == 0.0


def test_an_area_is_muted_while_the_gripper_is_elsewhere() -> None:
    policy = areas_policy(AreasSettings((replace(RED, guarded=((5.0, 5.0), (6.0, 7.0))), ORANGE)))
    seen = standing_at((0.5, 0.5))
    for gripper, zone in (((5.0, 5.0), "red"), ((6.0, 7.0), "red"), ((5.5, 7.001), "orange"), ((0.5, 0.5), "orange")):
        seen.gripper = (*gripper, 1.0)
        assert policy(seen).zone == zone


@pytest.mark.parametrize("bands", [(Band(0.5, 0.0), Band(1.0, 0.4)), (Band(1.0, 0.4), Band(0.5, 0.0))])
def test_a_band_holds_below_its_distance_and_not_at_it(bands: tuple[Band, ...]) -> None:
    policy = distance_policy(DistanceSettings(bands))
    scales = {away: policy(Seen(distance_m=away)).scale for away in (-0.1, 0.0, 0.499, 0.5, 0.999, 1.0, 10.0)}
    assert scales == {-0.1: 0.0, 0.0: 0.0, 0.499: 0.0, 0.5: 0.4, 0.999: 0.4, 1.0: 1.0, 10.0: 1.0}
    assert policy(Seen(distance_m=0.7)).zone == "nearer than 1 m"


def test_the_speed_allowed_is_that_worked_out_by_hand() -> None:
    assert allowed_speed(0.65, SIMULATOR) == pytest.approx(math.sqrt(0.1) - 0.1)
    assert allowed_speed(1.0, SIMULATOR) == pytest.approx(0.312311, abs=1e-6)
    assert allowed_speed(1.0, REAL_CELL) == pytest.approx(0.112461, abs=1e-6)
    assert allowed_speed(2.0, REAL_CELL) == pytest.approx(0.559675, abs=1e-6)
    assert allowed_speed(1.0, NN_SSM) == pytest.approx(0.613557, abs=1e-6)
    assert allowed_speed(2.0, NN_SSM) == pytest.approx(1.445618, abs=1e-6)


@pytest.mark.parametrize("settings", SETS)
def test_nothing_is_allowed_within_the_clearance_and_what_the_human_walks_meanwhile(settings: SsmSettings) -> None:
    for away in (-1.0, 0.0, settings.clearance_m):
        assert allowed_speed(away, settings) == 0.0
    first = settings.clearance_m + settings.human_speed * settings.reaction_s
    assert allowed_speed(first, settings) == pytest.approx(0.0, abs=1e-9)
    assert allowed_speed(first + 0.01, settings) > 0.0
    if settings.human_speed:
        assert allowed_speed(first - 0.01, settings) == 0.0


@given(settings_of_ssm, st.floats(-1.0, 5.0), st.floats(0.0, 5.0))
def test_more_distance_never_allows_less(settings: SsmSettings, away: float, more: float) -> None:
    assert allowed_speed(away, settings) <= allowed_speed(away + more, settings) + 1e-12


def test_the_speed_allowed_has_the_shape_of_the_distances() -> None:
    away = np.linspace(0.0, 3.0, 12).reshape(3, 4)
    speeds = allowed_speed(away, NN_SSM)
    assert speeds.shape == (3, 4)
    assert speeds.tolist() == [[float(allowed_speed(float(one), NN_SSM)) for one in row] for row in away]


@given(settings_of_ssm, st.floats(0.0, 4.0))
def test_a_robot_at_the_speed_allowed_stands_before_the_human_is_nearer_than_the_clearance(
    settings: SsmSettings, away: float
) -> None:
    speed = float(allowed_speed(away, settings))
    assume(speed > 0.0)
    dt = 1e-4 * (settings.reaction_s + speed / settings.deceleration)
    time_s, gap, going = 0.0, away, speed
    while going > 0.0:
        braked = max(speed - settings.deceleration * max(time_s + dt - settings.reaction_s, 0.0), 0.0)
        gap -= (settings.human_speed + (going + braked) / 2) * dt
        time_s, going = time_s + dt, braked
    slack = 2 * dt * (settings.human_speed + speed) + 1e-12  # a picometre: the steps round, however small they are
    assert gap >= settings.clearance_m - slack
    assert gap <= settings.clearance_m + slack, "slower than it need be"


@given(st.lists(st.tuples(st.floats(-0.5, 3.0), st.floats(-3.0, 0.0)), max_size=5))
def test_links_that_recede_are_not_restricted_however_near(pairs: list[tuple[float, float]]) -> None:
    seen = Seen(distances=tuple(away for away, _ in pairs), speeds=tuple(speed for _, speed in pairs))
    assert ssm_policy(NN_SSM)(seen) == FREE


def test_the_pair_that_leaves_least_decides() -> None:
    seen = Seen(distances=(2.0, 1.0, 0.1, 3.0), speeds=(2.0, 1.0, -1.0, 0.1))
    limit = ssm_policy(NN_SSM)(seen)
    assert limit.scale == pytest.approx(0.613557, abs=1e-6)
    assert limit.zone == "separation"
    assert ssm_policy(NN_SSM)(Seen(distances=(0.2, 2.0), speeds=(0.01, 1.0))) == Limit(0.0, "separation")


@given(
    settings_of_ssm,
    st.lists(st.tuples(st.floats(-0.5, 3.0), st.floats(-3.0, 3.0)), max_size=6),
)
def test_at_the_scale_of_separation_no_pair_comes_nearer_faster_than_allowed(
    settings: SsmSettings, pairs: list[tuple[float, float]]
) -> None:
    seen = Seen(distances=tuple(away for away, _ in pairs), speeds=tuple(speed for _, speed in pairs))
    limit = ssm_policy(settings)(seen)
    assert 0.0 <= limit.scale <= 1.0
    assert (limit.scale == 1.0) == (limit.zone == "")
    for away, speed in pairs:
        assert limit.scale * speed <= max(float(allowed_speed(away, settings)), 1e-3) + 1e-12


@given(
    st.sampled_from(list(POLICIES)),
    st.lists(st.tuples(st.floats(-3, 3), st.floats(-3, 3)), max_size=4),
    st.floats(-0.5, 3.0),
    st.floats(-3.0, 3.0),
)
def test_every_policy_answers_with_a_share(
    name: str, points: list[tuple[float, float]], away: float, speed: float
) -> None:
    settings = SafetySettings(areas=AreasSettings((RED, ORANGE)))
    policy, _, deceleration = make_policy(name, settings)
    seen = standing_at(*points)
    seen.distance_m, seen.distances, seen.speeds = away, (away,), (speed,)
    assert 0.0 <= policy(seen).scale <= 1.0
    assert deceleration > 0.0


def test_a_policy_comes_with_its_own_slew_and_brakes() -> None:
    settings = SafetySettings(
        areas=AreasSettings((), Slew(1.0, 0.1), 1.5),
        distance=DistanceSettings((), Slew(2.0, 0.2), 2.0),
        ssm=SsmSettings(deceleration=3.0, slew=Slew(3.0, 0.3)),
    )
    assert [make_policy(name, settings)[1:] for name in POLICIES] == [
        (Slew(1.0, 0.1), 1.5),
        (Slew(2.0, 0.2), 2.0),
        (Slew(3.0, 0.3), 3.0),
    ]
    with pytest.raises(KeyError):
        make_policy("none", settings)


def test_a_robot_never_brakes_less_than_separation_reckons_with() -> None:
    for brakes, expected in ((1.0, 3.0), (4.0, 4.0)):
        assert make_policy("ssm", SafetySettings(ssm=SsmSettings(deceleration=3.0, brakes=brakes)))[2] == expected


def ticks_to(override: Override, limit: float, speed: float, dt: float = 0.01) -> int:
    """Return how many ticks an override takes to reach a limit."""
    count = 0
    while abs(override.scale - limit) > 1e-12:
        override.advance(limit, speed, dt)
        count += 1
        assert count < 100_000, "it never gets there"
    return count


def test_a_slewed_stop_falls_in_a_second_and_takes_ten_to_recover() -> None:
    override = Override(Slew(fall_per_s=1.0, rise_per_s=0.1), deceleration=1000.0)
    assert ticks_to(override, 0.0, 1.0) in (100, 101)
    assert ticks_to(override, 1.0, 1.0) in (1000, 1001)


def test_the_slew_holds_for_a_robot_that_stands_too() -> None:
    override = Override(Slew(fall_per_s=1.0, rise_per_s=0.1), deceleration=2.5)
    assert ticks_to(override, 0.0, 0.0) in (100, 101)
    assert ticks_to(override, 0.5, 0.0) in (500, 501)


def test_without_slew_a_robot_that_stands_obeys_at_once() -> None:
    override = Override(Slew(), deceleration=2.5)
    assert override.advance(0.0, 0.0, 0.01) == 0.0
    assert override.advance(1.0, 0.0, 0.01) == 1.0


@pytest.mark.parametrize(("deceleration", "speed"), [(2.5, 1.0), (1.0, 2.0), (0.5, 0.25)])
def test_a_robot_brakes_and_speeds_up_with_the_deceleration_of_its_brakes(deceleration: float, speed: float) -> None:
    override = Override(Slew(), deceleration)
    seconds = ticks_to(override, 0.0, speed, 0.001) * 0.001
    assert seconds == pytest.approx(speed / deceleration, abs=0.0011)
    assert ticks_to(override, 1.0, speed, 0.001) * 0.001 == pytest.approx(speed / deceleration, abs=0.0011)


def test_the_slower_of_slew_and_brakes_counts() -> None:
    assert Override(Slew(fall_per_s=1.0), 0.5).advance(0.0, 1.0, 0.1) == pytest.approx(0.95)
    assert Override(Slew(fall_per_s=0.2), 0.5).advance(0.0, 1.0, 0.1) == pytest.approx(0.98)


rates = st.none() | st.floats(0.01, 10.0)


@given(
    st.builds(Slew, rates, rates),
    st.floats(0.1, 10.0),
    st.lists(st.tuples(scales, st.floats(0.0, 3.0), st.floats(0.001, 0.5)), max_size=30),
)
def test_the_override_stays_a_share_and_is_over_the_limit_only_while_it_falls_as_fast_as_it_can(
    slew: Slew, deceleration: float, wishes: list[tuple[float, float, float]]
) -> None:
    override = Override(slew, deceleration)
    for limit, speed, dt in wishes:
        before = override.scale
        after = override.advance(limit, speed, dt)
        assert after == override.scale
        assert 0.0 <= after <= 1.0
        assert min(before, limit) <= after <= max(before, limit), "it never overshoots"
        brakes = deceleration / speed if speed else math.inf
        fall, rise = (min(brakes, rate or math.inf) * dt for rate in (slew.fall_per_s, slew.rise_per_s))
        assert before - after <= fall + 1e-12
        assert after - before <= rise + 1e-12
        if after > limit:
            assert before - after == pytest.approx(fall, abs=1e-12)
        if after < limit:
            assert after - before == pytest.approx(rise, abs=1e-12)
