"""A way around obstacles in joint space, found by growing a tree from each end."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from hrclog.arrays import FloatArray

Free = Callable[[FloatArray], bool]


class Random(Protocol):
    """What is asked of a source of random numbers."""

    def random(self) -> float:
        """Return a number from [0, 1)."""


class _Tree:
    """Joint positions, each with the one it was reached from."""

    def __init__(self, root: FloatArray, capacity: int) -> None:
        self.nodes = np.empty((capacity, len(root)))
        self.parents = [-1]
        self.nodes[0] = root

    def add(self, q: FloatArray, parent: int) -> int:
        """Add a node and return its number."""
        number = len(self.parents)
        if number == len(self.nodes):
            self.nodes = np.concatenate((self.nodes, np.empty_like(self.nodes)))
        self.nodes[number] = q
        self.parents.append(parent)
        return number

    def nearest(self, q: FloatArray) -> int:
        """Return the number of the node nearest to a position, the oldest of several."""
        offsets = self.nodes[: len(self.parents)] - q
        return int(np.argmin(np.einsum("ij,ij->i", offsets, offsets)))

    def branch(self, number: int) -> list[FloatArray]:
        """Return the nodes from a node to the root."""
        nodes = []
        while number >= 0:
            nodes.append(self.nodes[number].copy())
            number = self.parents[number]
        return nodes


def edge_free(start: FloatArray, end: FloatArray, free: Free, resolution: float) -> bool:
    """Return whether a straight line in joint space is free, its end included and its start not.

    Args:
        start: joint positions, shape (n,).
        end: joint positions, shape (n,).
        free: whether the robot may stand at joint positions.
        resolution: the greatest change of a joint between two checks.
    """
    travel = end - start
    count = max(math.ceil(float(np.abs(travel).max()) / resolution), 1)
    return all(free(start + travel * (number / count)) for number in range(1, count)) and free(end)


def rrt_connect(
    start: FloatArray,
    goal: FloatArray,
    lower: Sequence[float] | FloatArray,
    upper: Sequence[float] | FloatArray,
    free: Free,
    random: Random,
    *,
    step: float = 0.3,
    resolution: float = 0.05,
    max_iterations: int = 2000,
    shortcuts: int = 100,
) -> list[FloatArray] | None:
    """Return waypoints of a free way from start to goal, or None where none is found.

    J. J. Kuffner and S. M. LaValle, RRT-Connect: an efficient approach to single-query path planning, ICRA 2000; then
    random shortcuts. The straight line comes first. Only `random.random()` is used, so equal streams find equal ways.

    Args:
        start: joint positions, shape (n,).
        goal: joint positions, shape (n,).
        lower: limits of the joints, n numbers.
        upper: limits of the joints, n numbers.
        free: whether the robot may stand at joint positions.
        random: where random numbers come from.
        step: the greatest length of an edge of a tree.
        resolution: the greatest change of a joint between two checks of an edge.
        max_iterations: random positions to try.
        shortcuts: pairs of points on the way to try to join.
    """
    if not (free(start) and free(goal)):
        return None
    if edge_free(start, goal, free, resolution):
        return [start, goal]
    low, span = np.asarray(lower, dtype=np.float64), np.subtract(upper, lower)
    tree, other_tree = _Tree(start, max_iterations), _Tree(goal, max_iterations)
    for iteration in range(max_iterations):
        sample = low + span * np.array([random.random() for _ in range(len(low))])
        reached, _ = _grow(tree, sample, free, step, resolution, once=True)
        meeting_node, joined = (-1, False)
        if reached >= 0:
            meeting_node, joined = _grow(other_tree, tree.nodes[reached], free, step, resolution, once=False)
        if joined:
            way = [*tree.branch(reached)[::-1], *other_tree.branch(meeting_node)[1:]]
            return shortcut(way if iteration % 2 == 0 else way[::-1], free, random, resolution, shortcuts)
        tree, other_tree = other_tree, tree
    return None


def shortcut(
    way: Sequence[FloatArray], free: Free, random: Random, resolution: float, attempts: int
) -> list[FloatArray]:
    """Return a way that is no longer: random pairs of points on it are joined by straight lines where these are free.

    Args:
        way: waypoints, each of shape (n,).
        free: whether the robot may stand at joint positions.
        random: where random numbers come from.
        resolution: the greatest change of a joint between two checks.
        attempts: pairs to try.
    """
    way = list(way)
    for _ in range(attempts):
        if len(way) <= 2:
            break
        early, late = sorted(random.random() * (len(way) - 1) for _ in range(2))
        first, last = int(early), int(late)
        if first == last:
            continue
        a, b = _interpolate(way, early), _interpolate(way, late)
        edges = ((a, b), (way[first], a), (b, way[last + 1]))  # halves of a free edge are checked at other points
        if all(edge_free(*edge, free, resolution) for edge in edges):
            way = [*way[: first + 1], a, b, *way[last + 1 :]]
    return _straighten(way, free, resolution)


def _grow(
    tree: _Tree, target: FloatArray, free: Free, step: float, resolution: float, *, once: bool
) -> tuple[int, bool]:
    """Grow a tree towards a position, by one step or until it is reached or blocked.

    Returns:
        The number of the last node that was added (-1 for none), and whether it is the position.
    """
    number, last = tree.nearest(target), -1
    while True:
        node = tree.nodes[number]
        offset = target - node
        distance = float(np.linalg.norm(offset))
        arrived = distance <= step
        q = target if arrived else node + offset * (step / distance)
        if not edge_free(node, q, free, resolution):
            return last, False
        number = last = tree.add(q, number)
        if arrived or once:
            return last, arrived


def _interpolate(way: Sequence[FloatArray], place: float) -> FloatArray:
    number = int(place)
    return way[number] + (place - number) * (way[number + 1] - way[number])


def _straighten(way: list[FloatArray], free: Free, resolution: float) -> list[FloatArray]:
    """Return a way without the waypoints that it does not need: from each on to the farthest in sight."""
    waypoints, index = [way[0]], 0
    while index < len(way) - 1:
        farthest = len(way) - 1
        while farthest > index + 1 and not edge_free(way[index], way[farthest], free, resolution):
            farthest -= 1
        waypoints.append(way[farthest])
        index = farthest
    return waypoints
