"""An agent's speed scale over time, as its safety events tell it."""

from __future__ import annotations

from typing import Final

import numpy as np
import polars as pl

from hrclog.arrays import FloatArray, IntArray

STOPPED_AT: Final = 0.1
"""A speed scale up to this counts as stopped."""


class SpeedProfile:
    """A speed scale that is constant between changes, and 1 before the first.

    Args:
        time_ns: instants of change, shape (n,), sorted.
        scale: scale from each instant on, shape (n,).
    """

    def __init__(self, time_ns: IntArray, scale: FloatArray) -> None:
        self.time_ns = time_ns
        self.scale = scale

    def pieces(self, start: IntArray, end: IntArray) -> tuple[IntArray, IntArray, FloatArray]:
        """Return (begin, end, scale) of the constant pieces within disjoint sorted blocks."""
        if not len(start):
            return start, end, np.empty(0)
        edges = np.unique(np.concatenate([start, end, self.time_ns]))
        begins, ends = edges[:-1], edges[1:]
        block = np.searchsorted(start, begins, "right") - 1
        inside = (block >= 0) & (begins < end[block])
        begins, ends = begins[inside], ends[inside]
        changed = np.searchsorted(self.time_ns, begins, "right")
        return begins, ends, np.concatenate([[1.0], self.scale])[changed]

    def lost_ns(self, start: IntArray, end: IntArray) -> float:
        """Return the integral of 1 - scale over disjoint sorted blocks."""
        begins, ends, scale = self.pieces(start, end)
        return float(((ends - begins) * (1 - scale)).sum())

    def stops_within(self, start: IntArray, end: IntArray) -> IntArray:
        """Return the lengths in ns of the stops within disjoint sorted blocks; a stop may join several pieces."""
        begins, ends, scale = self.pieces(start, end)
        stopped = scale <= STOPPED_AT
        begins, ends = begins[stopped], ends[stopped]
        if not len(begins):
            return np.empty(0, np.int64)
        opens = np.append(True, begins[1:] != ends[:-1])
        return np.add.reduceat(ends - begins, np.flatnonzero(opens))


def speed_profiles(events: pl.DataFrame) -> dict[str, dict[str, SpeedProfile]]:
    """Return run -> agent -> speed profile, for agents whose safety events name a speed scale."""
    changes = events.filter(
        (pl.col("kind") == "safety_state_changed") & pl.col("speed_scale").is_not_null() & (pl.col("agent") != "")
    ).sort("run_id", "agent", "time_ns", "seq")
    profiles: dict[str, dict[str, SpeedProfile]] = {}
    for (run, agent), part in changes.group_by("run_id", "agent", maintain_order=True):
        profile = SpeedProfile(part["time_ns"].to_numpy(), part["speed_scale"].to_numpy())
        profiles.setdefault(str(run), {})[str(agent)] = profile
    return profiles
