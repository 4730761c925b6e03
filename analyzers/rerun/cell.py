"""The cell of a run as Rerun entities under /cell, and the view on it.

A body's links are frames of Rerun's transform graph. Their names contain the agent, so that two bodies may have equal
links. Boxes and areas are plain entities. Each position holds until the next one.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.urdf import UrdfTree

from hrclog.analyzers.figures.cell import CellFigure, LitArea, Machine, MovedBox, quaternion
from hrclog.analyzers.figures.palette import CARD, MUTED
from hrclog.analyzers.figures.text import shorten
from hrclog.analyzers.rerun.recording import entity, times
from hrclog.arrays import FloatArray
from hrclog.scene import Box, Slot

ROOT: Final = "cell"

_AREA_M: Final = 0.004  # height of what is drawn on the floor
_SLOT_M: Final = 0.05


def send_cell(rec: rr.RecordingStream, cell: CellFigure) -> list[str]:
    """Send a cell, and return captions of the parts that Rerun could not draw."""
    if cell.fixtures:
        rec.log(entity(ROOT, "fixtures"), _boxes(cell.fixtures), static=True, strict=True)
    if cell.slots:
        rec.log(entity(ROOT, "slots"), _slots(cell.slots), static=True, strict=True)
    for number, area in enumerate(cell.areas):
        _send_area(rec, area, number)
    for box in cell.boxes:
        _send_box(rec, box)
    return [caption for machine in cell.machines for caption in _send_machine(rec, machine)]


def cell_view(cell: CellFigure) -> rrb.View:
    """Return the view on a cell."""
    center = (cell.low + cell.high) / 2
    reach = max(float(np.linalg.norm(cell.high - cell.low)) / 2, 0.5)
    eye = rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=center + reach * _EYE,
        look_target=center,
        eye_up=(0.0, 0.0, 1.0),
    )
    solid = rr.components.FillMode.Solid  # of bodies, whose descriptions say nothing of it
    shapes = (rr.Boxes3D, rr.Cylinders3D, rr.Ellipsoids3D, rr.Capsules3D)
    return rrb.Spatial3DView(
        origin=f"/{ROOT}",
        name="Cell",
        background=CARD,
        eye_controls=eye,
        line_grid=False,
        defaults=[shape.from_fields(fill_mode=solid) for shape in shapes],
    )


_EYE: Final = np.array([-1.2, 1.15, 1.5])


def _boxes(boxes: Iterable[Box]) -> rr.Boxes3D:
    boxes = list(boxes)
    return rr.Boxes3D(
        centers=[box.position for box in boxes],
        half_sizes=_halves(boxes),
        quaternions=[rr.Quaternion(xyzw=quaternion(box.yaw)) for box in boxes],
        colors=[box.color for box in boxes],
        labels=[shorten(box.name, 40) for box in boxes],
        show_labels=False,
        fill_mode=rr.components.FillMode.Solid,
    )


def _halves(boxes: Iterable[Box]) -> FloatArray:
    return np.array([box.size for box in boxes]) / 2


def _slots(slots: Iterable[Slot]) -> rr.Boxes3D:
    slots = list(slots)
    return rr.Boxes3D(
        centers=[slot.position for slot in slots],
        half_sizes=np.full((len(slots), 3), _SLOT_M / 2),
        colors=[MUTED],
        labels=[shorten(slot.name, 40) for slot in slots],
        show_labels=False,
        fill_mode=rr.components.FillMode.MajorWireframe,
    )


def _send_area(rec: rr.RecordingStream, lit: LitArea, number: int) -> None:
    path, area = entity(ROOT, "areas", lit.area.name), lit.area
    (x0, y0), (x1, y1) = area.low, area.high
    level = _AREA_M * (number + 1)  # smaller areas lie on larger ones
    shape = rr.Boxes3D(
        centers=[((x0 + x1) / 2, (y0 + y1) / 2, level)],
        half_sizes=[((x1 - x0) / 2, (y1 - y0) / 2, _AREA_M / 4)],
        labels=[f"{shorten(area.name, 40)} ({area.kind})"],
        show_labels=False,
        fill_mode=rr.components.FillMode.Solid,
    )
    corners = [(x, y, level + _AREA_M / 2) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0))]
    rec.log(path, shape, static=True, strict=True)
    rec.log(f"{path}/rim", rr.LineStrips3D([corners], colors=[lit.rim], radii=-1.0), static=True, strict=True)
    rec.send_columns(path, [times(lit.times_ns)], rr.Boxes3D.columns(colors=lit.colors), strict=True)


def _send_box(rec: rr.RecordingStream, moved: MovedBox) -> None:
    path, box = entity(ROOT, "objects", moved.box.name), moved.box
    shape = rr.Boxes3D(
        half_sizes=_halves([box]),
        colors=[box.color],
        labels=[shorten(box.name, 40)],
        show_labels=False,
        fill_mode=rr.components.FillMode.Solid,
    )
    rec.log(path, shape, static=True, strict=True)
    columns = rr.Transform3D.columns(translation=moved.positions, quaternion=moved.quaternions)
    rec.send_columns(path, [times(moved.times_ns)], columns, strict=True)


def _send_machine(rec: rr.RecordingStream, machine: Machine) -> list[str]:
    try:
        tree = _load_tree(machine)
        rec.send_chunks(tree.stream(include_joint_transforms=False))
        moving = {track.name: track for track in machine.joints}
        for joint in tree.joints():
            path = entity(ROOT, "joints", machine.agent, joint.name)
            track = moving.get(joint.name)
            if track is None:
                rec.log(path, joint.compute_transform(0.0, clamp=False), static=True, strict=True)
            else:
                columns = joint.compute_transform_columns(track.values.tolist(), clamp=False)
                rec.send_columns(path, [times(track.times_ns)], columns, strict=True)
        _send_base(rec, machine)
    except (RuntimeError, NotImplementedError, ValueError) as error:  # what Rerun raises of descriptions
        return [f"The body of {shorten(machine.agent, 40)!r}: {shorten(str(error), 200)}."]
    return []


def _load_tree(machine: Machine) -> UrdfTree:
    with TemporaryDirectory(prefix="hrclog-") as folder:
        path = Path(folder) / "body.urdf"
        path.write_text(machine.urdf.text, encoding="utf-8")
        return UrdfTree.from_file_path(path, entity_path_prefix=ROOT, frame_prefix=_frame(machine, ""))


def _send_base(rec: rr.RecordingStream, machine: Machine) -> None:
    base = rr.Transform3D(
        translation=machine.base.position,
        quaternion=rr.Quaternion(xyzw=quaternion(machine.base.yaw)),
        parent_frame=f"tf#/{ROOT}",
        child_frame=_frame(machine, machine.urdf.root),
    )
    rec.log(entity(ROOT, "bases", machine.agent), base, static=True, strict=True)


def _frame(machine: Machine, link: str) -> str:
    return f"{machine.name}/{link}"
