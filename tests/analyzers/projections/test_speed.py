"""Speed profiles and the safety metrics that follow from them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from event_frames import event
from event_frames import frame as events_frame
from hypothesis import given
from hypothesis import strategies as st
from interval_frames import frame, row

from hrclog.analyzers.projections.metrics import metrics, nested
from hrclog.analyzers.projections.speed import SpeedProfile, speed_profiles

SECOND = 1_000_000_000
SCALES = (0.0, 0.1, 0.25, 0.5, 1.0)

changes = st.lists(st.tuples(st.integers(0, 30), st.sampled_from(SCALES)), max_size=8)
spans = st.lists(st.tuples(st.integers(1, 5), st.integers(1, 6)), max_size=4)


def change(time_s: float, scale: float | None, agent: str = "R", **values: object) -> dict[str, Any]:
    return event("safety_state_changed", round(time_s * 1e9), agent=agent, speed_scale=scale, **values)


def scale_at(instant: int, found: list[tuple[int, float]]) -> float:
    return ([1.0] + [scale for time, scale in sorted(found, key=lambda one: one[0]) if time <= instant])[-1]


@given(changes, spans)
def test_stops_and_lost_time_are_those_counted_instant_by_instant(
    found: list[tuple[int, float]], gaps: list[tuple[int, int]]
) -> None:
    starts, ends, now = [], [], 0
    for gap, length in gaps:
        starts.append(now + gap)
        now += gap + length
        ends.append(now)
    ordered = sorted(found, key=lambda one: one[0])
    profile = SpeedProfile(np.array([time for time, _ in ordered], np.int64), np.array([s for _, s in ordered], float))
    blocks = (np.array(starts, np.int64), np.array(ends, np.int64))
    busy = [instant for low, high in zip(starts, ends, strict=True) for instant in range(low, high)]
    assert profile.lost_ns(*blocks) == pytest.approx(sum(1 - scale_at(instant, found) for instant in busy))
    stopped = [instant for instant in busy if scale_at(instant, found) <= 0.1]
    first = [n for n, instant in enumerate(stopped) if instant - 1 not in stopped[:n]]
    lengths = np.diff([*first, len(stopped)]).tolist()
    assert profile.stops_within(*blocks).tolist() == lengths


def hand_made() -> dict[str, Any]:
    """Return the metrics of a robot that is slowed and stopped.

    It works 0-10 and 20-30 s. It creeps at 0.5 from 2 s, stands from 4 to 7 (0.1, then 0), runs at 1 from 7 s, and
    stands from 9 to 22 s, of which 1 + 2 s while it works.
    """
    executions = [row("R", "x", 0, 10 * SECOND), row("R", "y", 20 * SECOND, 30 * SECOND), row("H", "z", 0, 5 * SECOND)]
    scales = [(2, 0.5), (4, 0.1), (5, 0.0), (7, 1.0), (9, 0.0), (22, 1.0)]
    events = events_frame([change(*one) for one in scales])
    return nested(metrics(frame(executions), events))["run"]


def test_the_safety_metrics_of_a_hand_made_profile() -> None:
    found = hand_made()
    assert found["safety_stop_s"] == {"R": pytest.approx(3 + 1 + 2)}
    assert found["safety_stop_count"] == {"R": 3}
    assert found["safety_stop_longest_s"] == {"R": pytest.approx(3)}
    lost = 2 * 0.5 + 1 * 0.9 + 2 * 1 + 1 + 2
    assert found["lost_time_s"] == {"R": pytest.approx(lost)}
    assert found["mean_speed_scale"] == {"R": pytest.approx(1 - lost / 20)}


def test_a_run_without_speed_scales_has_no_safety_metrics() -> None:
    events = events_frame([change(1, None, mode="monitored"), change(1, 0.0, agent="")])
    assert speed_profiles(events) == {}
    assert "safety_stop_s" not in nested(metrics(frame([row("R", "x", 0, SECOND)]), events))["run"]


def test_of_two_changes_at_one_instant_the_later_written_holds() -> None:
    events = events_frame([change(1, 0.0), change(1, 0.5)])
    profile = speed_profiles(events)["run"]["R"]
    blocks = (np.array([0]), np.array([2 * SECOND]))
    assert profile.lost_ns(*blocks) == pytest.approx(0.5 * SECOND)


def test_an_agent_that_did_nothing_has_no_safety_metrics() -> None:
    found = nested(metrics(frame([row("H", "x", 0, SECOND)]), events_frame([change(0, 0.0)])))["run"]
    assert "safety_stop_s" not in found
