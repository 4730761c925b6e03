"""Carry plans out in worlds: exact discrete events, many plans and worlds at once.

An agent is given its next item when it is free and what the item waits for is there; after a gap it starts, and works
at the product over the other agents' running tasks of 1 / s. Between two events all rates stand still, so nothing is
approximated.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from hrclog.analyzers.search.encoded import END, Encoded
from hrclog.analyzers.search.worlds import Worlds
from hrclog.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Begun:
    """Where a run stands from which plans go on; an agent that works does the first item that is not over.

    Attributes:
        now_s: since the run's start.
        first_s: when its first execution started; None before that.
        over: by agent: how many items of its queue are over.
        started_s: by agent that works: when its item started.
        left_s: by agent that works: what is left of its work in each world, shape (S,).
    """

    now_s: float = 0.0
    first_s: float | None = None
    over: dict[str, int] = field(default_factory=dict)
    started_s: dict[str, float] = field(default_factory=dict)
    left_s: dict[str, FloatArray] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Evaluated:
    """What comes of B plans in S worlds.

    Attributes:
        makespan_s: from the first start to the last end, infinite where a plan does not come to its end; (B, S).
        cost: of what ran beside what, by the matrix that was given; (B, S).
        start_s: of each item since the run's start, NaN past the last one; (B, S, A, P). None unless asked for.
        end_s: as `start_s`.
    """

    makespan_s: FloatArray
    cost: FloatArray
    start_s: FloatArray | None = None
    end_s: FloatArray | None = None


def evaluate(
    plans: Encoded,
    worlds: Worlds,
    *,
    begun: Begun | None = None,
    cost: FloatArray | None = None,
    timeline: bool = False,
) -> Evaluated:
    """Carry every plan out in every world.

    Args:
        plans: B plans.
        worlds: S worlds, of the same agents and keys.
        begun: where to go on from; default the start of a run.
        cost: per second in which two agents work on keys i and j, shape (K + 1, K + 1), symmetric; default none.
        timeline: whether starts and ends are wanted.
    """
    lanes = _Lanes(plans, worlds, begun or Begun(), cost, timeline=timeline)
    while lanes.step():
        pass
    return lanes.result()


class _Lanes:
    """B x S runs side by side; arrays of shape (A, L), L = B S, a lane per plan and world."""

    def __init__(
        self,
        plans: Encoded,
        worlds: Worlds,
        begun: Begun,
        cost: FloatArray | None,
        *,
        timeline: bool,
    ) -> None:
        self._plans = plans
        n_agents, self._width = plans.task.shape[1:]
        self._shape = (plans.size, worlds.count)
        lanes = plans.size * worlds.count
        plan, world = np.divmod(np.arange(lanes), worlds.count)
        agent = np.arange(n_agents)[:, None]
        self._item_base = (plan * n_agents + agent) * self._width
        n_keys, n_repeats = worlds.work_s.shape[1:]
        self._idle = n_keys
        self._work_base = world * n_keys * n_repeats
        self._n_repeats = n_repeats
        self._gap_base = (world * worlds.gap_s.shape[1] + agent) * worlds.gap_s.shape[2]
        self._last_gap = worlds.gap_s.shape[2] - 1
        self._rate_base = world * (n_keys + 1) ** 2
        self._task, self._repeat = plans.task.ravel(), plans.repeat.ravel()
        self._work, self._gap = np.ravel(worlds.work_s), np.ravel(worlds.gap_s)
        self._rate = np.ravel(worlds.rate)
        self._waits = None if plans.waits is None else plans.waits.reshape(-1, n_agents)
        self._not_before = None if plans.not_before_s is None else plans.not_before_s.ravel()
        self._resources = None if plans.resources is None else plans.resources.ravel()
        asked = np.broadcast_to(np.arange(n_agents), (plans.size, n_agents)) if plans.asked is None else plans.asked
        self._asked, self._lane = asked[plan].T, np.arange(lanes)
        self._cost_of = None if cost is None else cost.ravel()
        self._pairs = list(combinations(range(n_agents), 2))

        self._now = np.full(lanes, begun.now_s)
        self._first = np.full(lanes, np.inf if begun.first_s is None else begun.first_s)
        self._position = np.zeros((n_agents, lanes), np.int64)
        self._given = np.zeros((n_agents, lanes), np.bool_)  # its next item, which may not have started yet
        self._start = np.full((n_agents, lanes), np.inf)
        self._left = np.full((n_agents, lanes), np.inf)  # of the running item's work
        self._key = np.full((n_agents, lanes), self._idle, np.int64)  # what runs
        self._cost = np.zeros(lanes)
        self._starts = self._ends = None
        if timeline:
            self._starts, self._ends = (np.full(plans.task.size * worlds.count, np.nan) for _ in range(2))
            self._time_base = ((plan * worlds.count + world) * n_agents + agent) * self._width
        self._resume(begun, world)

    def _resume(self, begun: Begun, world: IntArray) -> None:
        for name, over in begun.over.items():
            self._position[self._plans.agents.index(name)] = over
        for name, started in begun.started_s.items():
            agent = self._plans.agents.index(name)
            item = self._item_base[agent] + self._position[agent]
            self._given[agent] = True
            self._start[agent] = started
            self._left[agent] = begun.left_s[name][world]
            self._key[agent] = self._task[item]
            if self._starts is not None:
                self._starts[self._time_base[agent] + self._position[agent]] = started

    def step(self) -> bool:
        """Go on to the next event of each lane, and return whether any lane has one."""
        item = self._item_base + self._position
        task = self._task[item]
        wake = self._give_items(item, task)
        self._begin_items(item, task)
        rate = self._rates()
        runs = self._key != self._idle
        with np.errstate(divide="ignore"):
            end = np.where(runs, self._now + self._left / rate, np.inf)
        event = np.where(runs, end, np.where(self._given, self._start, wake))
        next_event = event.min(axis=0)
        goes_on = np.isfinite(next_event)
        if not goes_on.any():
            return False
        next_event = np.where(goes_on, next_event, self._now)
        elapsed = next_event - self._now
        if self._cost_of is not None:
            for a, b in self._pairs:
                self._cost += elapsed * self._cost_of[self._key[a] * (self._idle + 1) + self._key[b]]
        self._left = np.maximum(self._left - elapsed * rate, 0.0)  # rounding leaves a hair below nothing
        self._now = next_event
        self._finish_items(runs & (end <= next_event))
        return True

    def _give_items(self, item: IntArray, task: IntArray) -> FloatArray:
        """Give every free agent its next item if it may have it; return when those that wait for an instant wake."""
        free = ~self._given & (task != END)
        wake = np.full(free.shape, np.inf)
        if self._waits is not None:
            free &= (self._waits[item] <= self._position.T[None]).all(axis=2)
        if self._not_before is not None:
            instant = self._not_before[item]
            early = free & (instant > self._now)
            wake[early] = instant[early]
            free &= ~early
        if self._resources is not None:
            free = self._grant_resources(free, item)
        if free.any():
            place = np.minimum(self._position, self._last_gap)
            start = self._now + self._gap[self._gap_base + place]
            self._start = np.where(free, start, self._start)
            self._given |= free
        return wake

    def _grant_resources(self, free: BoolArray, item: IntArray) -> BoolArray:
        """Return which of the free agents get what their item holds, asked one after the other."""
        assert self._resources is not None  # noqa: S101 - the caller looked
        needed = self._resources[item]
        held = np.bitwise_or.reduce(np.where(self._given, needed, 0), axis=0)
        allowed = free.copy()
        for agent in self._asked:
            granted = allowed[agent, self._lane] & ((needed[agent, self._lane] & held) == 0)
            allowed[agent, self._lane] = granted
            held |= np.where(granted, needed[agent, self._lane], 0)
        return allowed

    def _begin_items(self, item: IntArray, task: IntArray) -> None:
        begins = self._given & (self._key == self._idle) & (self._start <= self._now)
        if not begins.any():
            return
        agent, lane = np.nonzero(begins)
        chosen, key = item[agent, lane], task[agent, lane]
        place = np.minimum(self._repeat[chosen], self._n_repeats - 1)
        self._left[agent, lane] = self._work[self._work_base[lane] + key * self._n_repeats + place]
        self._key[agent, lane] = key
        self._first = np.minimum(self._first, np.where(begins.any(axis=0), self._now, np.inf))
        if self._starts is not None:
            self._starts[self._time_base[agent, lane] + self._position[agent, lane]] = self._now[lane]

    def _rates(self) -> FloatArray:
        rate = np.ones(self._left.shape)
        for a, b in self._pairs:
            rate[a] *= self._rate[self._rate_base + self._key[a] * (self._idle + 1) + self._key[b]]
            rate[b] *= self._rate[self._rate_base + self._key[b] * (self._idle + 1) + self._key[a]]
        return rate

    def _finish_items(self, ends: BoolArray) -> None:
        if self._ends is not None:
            agent, lane = np.nonzero(ends)
            self._ends[self._time_base[agent, lane] + self._position[agent, lane]] = self._now[lane]
        self._position += ends
        self._given &= ~ends
        self._key[ends] = self._idle
        self._left[ends] = np.inf

    def result(self) -> Evaluated:
        """Return what came of the lanes."""
        done = (self._task[self._item_base + self._position] == END).all(axis=0)
        first = np.where(np.isfinite(self._first), self._first, self._now)
        makespan = np.where(done, self._now - first, np.inf)
        times = (
            None if array is None else array.reshape(*self._shape, *self._plans.task.shape[1:])[..., :-1]
            for array in (self._starts, self._ends)
        )
        return Evaluated(makespan.reshape(self._shape), self._cost.reshape(self._shape), *times)
