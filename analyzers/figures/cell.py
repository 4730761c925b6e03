"""The cell of a run in three dimensions: what stands in it, how things move, and which floor areas are lit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl

from hrclog.analyzers.figures.palette import CARD, FAILED, REDUCED, Color, blend
from hrclog.analyzers.figures.text import shorten
from hrclog.analyzers.figures.thinning import worth_drawing
from hrclog.analyzers.figures.urdf import Urdf, drawable
from hrclog.arrays import FloatArray, IntArray
from hrclog.log.messages.channels import topic_name
from hrclog.log.messages.recorded_scene import RunScene
from hrclog.scene import Area, Base, Box, Scene, Slot
from hrclog.wording import counted

MAX_AGENTS: Final = 8
MAX_SAMPLES: Final = 50_000

_FAINT: Final = 0.12  # share of an area's colour while it is dark
_LIT: Final = 0.8
_TALL_M: Final = 1.7  # bodies reach above what they stand at
_BESIDE_M: Final = 0.4  # and stand beside it
_KINDS: Final = {"red": FAILED, "orange": REDUCED}
_FARTHEST: Final = 1e4


@dataclass(frozen=True, slots=True, eq=False)
class JointTrack:
    """A joint's positions (rad or m, shape (n,)) at ns since the first event; each holds until the next."""

    name: str
    times_ns: IntArray
    values: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Machine:
    """An agent with a body. `name` is unique and a plain word; `joints` are those that were logged."""

    agent: str
    name: str
    urdf: Urdf
    base: Base
    joints: tuple[JointTrack, ...]


@dataclass(frozen=True, slots=True, eq=False)
class MovedBox:
    """A box with its positions (m, shape (n, 3)) and quaternions (x, y, z, w, shape (n, 4)), n at least 1."""

    box: Box
    times_ns: IntArray
    positions: FloatArray
    quaternions: FloatArray


@dataclass(frozen=True, slots=True)
class LitArea:
    """A floor area, the colour of its rim, and its colours (at least one) from ns since the first event on."""

    area: Area
    rim: Color
    times_ns: tuple[int, ...]
    colors: tuple[Color, ...]


@dataclass(frozen=True, slots=True, eq=False)
class CellFigure:
    """What to draw of a cell. Larger areas come first. `low` and `high` (m) are the corners of its contents."""

    machines: tuple[Machine, ...]
    boxes: tuple[MovedBox, ...]
    fixtures: tuple[Box, ...]
    areas: tuple[LitArea, ...]
    slots: tuple[Slot, ...]
    low: FloatArray
    high: FloatArray
    captions: tuple[str, ...] = ()


def cell_figure(
    cell: RunScene, events: pl.DataFrame, signals: pl.DataFrame, origin_ns: int, start_ns: int
) -> CellFigure:
    """Return the cell of a run.

    Args:
        cell: what was recorded of it.
        events: the run's flat events, which light the floor areas that safety states name as their zone.
        signals: the run's samples; joints are named agent/joint.
        origin_ns: of the figure's times, since the epoch.
        start_ns: the figure's first instant, since `origin_ns`.
    """
    machines, captions = _machines(cell, signals, origin_ns, start_ns)
    scene = cell.scene
    boxes = tuple(_moved_box(box, cell.poses, origin_ns, start_ns) for box in scene.boxes)
    unknown = cell.poses.filter(~pl.col("name").is_in([box.name for box in scene.boxes]))["name"].unique().sort()
    if len(unknown):
        name = shorten(unknown[0], 40)
        captions.append(f"Poses of {counted(len(unknown), 'object')} that the scene does not list, the first {name!r}.")
    low, high = _corners(scene, boxes)
    if machines:
        high[2] = max(high[2], _TALL_M)
        low[:2] -= _BESIDE_M
        high[:2] += _BESIDE_M
    by_size = sorted(scene.areas, key=_square_metres, reverse=True)
    areas = tuple(_lit_area(area, events, origin_ns, start_ns) for area in by_size)
    return CellFigure(machines, boxes, scene.fixtures, areas, scene.slots, low, high, captions=tuple(captions))


def _machines(
    cell: RunScene, signals: pl.DataFrame, origin_ns: int, start_ns: int
) -> tuple[tuple[Machine, ...], list[str]]:
    bases = {base.name: base for base in cell.scene.bases}
    machines: list[Machine] = []
    captions: list[str] = []
    for agent in sorted(cell.descriptions)[:MAX_AGENTS]:
        name, label = f"agent_{topic_name(agent)}", shorten(agent, 40)
        try:
            urdf = drawable(cell.descriptions[agent], name)
        except ValueError as error:
            captions.append(f"The body of {label!r}: {shorten(str(error), 200)}.")
            continue
        captions += [f"Of the body of {label!r}: {omission}." for omission in urdf.left_out]
        tracks = [_joint(signals, f"{agent}/{joint}", joint, origin_ns, start_ns) for joint in urdf.joints]
        base = bases.get(agent, Base(agent, (0.0, 0.0, 0.0)))
        machines.append(Machine(agent, name, urdf, base, tuple(track for track in tracks if len(track.times_ns))))
    if len(cell.descriptions) > MAX_AGENTS:
        further = len(cell.descriptions) - MAX_AGENTS
        captions.append(f"{counted(further, 'further agent with a body', 'further agents with bodies')}.")
    return tuple(machines), captions


def _joint(signals: pl.DataFrame, signal: str, joint: str, origin_ns: int, start_ns: int) -> JointTrack:
    samples = signals.filter((pl.col("name") == signal) & pl.col("value").is_between(-_FARTHEST, _FARTHEST))
    samples = samples.sort("time_ns", maintain_order=True)
    times, values = samples["time_ns"].to_numpy() - origin_ns, samples["value"].to_numpy()
    if len(times) and times[0] > start_ns:  # it stood before
        times, values = np.insert(times, 0, start_ns), np.insert(values, 0, values[0])
    indices = _limit_samples(worth_drawing(times, values[:, None]))
    return JointTrack(joint, times[indices], values[indices])


def _moved_box(box: Box, poses: pl.DataFrame, origin_ns: int, start_ns: int) -> MovedBox:
    box_poses = poses.filter(pl.col("name") == box.name).sort("time_ns", maintain_order=True)
    times = box_poses["time_ns"].to_numpy() - origin_ns
    resting_pose = [*box.position, *quaternion(box.yaw)]
    values = np.vstack([resting_pose, box_poses.select("x", "y", "z", "qx", "qy", "qz", "qw").to_numpy()])
    times = np.insert(times, 0, min([start_ns, *times[:1].tolist()]))
    indices = _limit_samples(worth_drawing(times, values))
    return MovedBox(box, times[indices], values[indices, :3], values[indices, 3:])


def quaternion(yaw: float) -> tuple[float, float, float, float]:
    """Return a rotation about z as x, y, z, w."""
    return 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)


def _limit_samples(indices: IntArray) -> IntArray:
    step = -(-len(indices) // MAX_SAMPLES)
    return indices if step <= 1 else np.union1d(indices[::step], indices[-1:])


def _square_metres(area: Area) -> float:
    return (area.high[0] - area.low[0]) * (area.high[1] - area.low[1])


def _lit_area(area: Area, events: pl.DataFrame, origin_ns: int, start_ns: int) -> LitArea:
    of_agent = pl.lit(True) if not area.agent else pl.col("agent") == area.agent
    changes = events.filter((pl.col("kind") == "safety_state_changed") & of_agent)
    dark = blend(CARD, _KINDS[area.kind], _FAINT)
    times, colors = [start_ns], [dark]
    for time_ns, mode, zone, scale in changes.select("time_ns", "mode", "zone", "speed_scale").rows():
        light = _light(mode, scale) if zone == area.name else None
        color = dark if light is None else blend(CARD, light, _LIT)
        if color != colors[-1]:
            times.append(max(time_ns - origin_ns, start_ns))
            colors.append(color)
    return LitArea(area, blend(CARD, _KINDS[area.kind], 0.5), tuple(times), tuple(colors))


def _light(mode: str, scale: float | None) -> Color | None:
    """Return the colour of a safety state, None if it allows the agent full speed."""
    if scale is None:
        return FAILED if "stop" in mode else None if mode in ("", "normal") else REDUCED
    return FAILED if scale <= 0.1 else REDUCED if scale < 1 else None


def _corners(scene: Scene, boxes: Sequence[MovedBox]) -> tuple[FloatArray, FloatArray]:
    """Return the corners around everything in the cell and everywhere that objects go."""
    points = [(*side, 0.0) for area in scene.areas for side in (area.low, area.high)]
    points += [slot.position for slot in scene.slots] + [base.position for base in scene.bases]
    point_sets = [np.array(points).reshape(-1, 3), *[moved.positions for moved in boxes]]
    point_sets += [np.array(box.position) + np.array(box.size) / 2 * side for box in scene.fixtures for side in (-1, 1)]
    all_points = np.vstack(point_sets)
    if not len(all_points):  # bodies alone
        return np.array([-1.0, -1.0, 0.0]), np.array([1.0, 1.0, 1.5])
    return all_points.min(axis=0), all_points.max(axis=0)
