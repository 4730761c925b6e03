"""A cell as the scene of a log."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hrclog.scene import SCENE_VERSION
from hrclog.sim.cell.description import Box, Cell
from hrclog.sim.cell.safety_settings import AREAS


def scene_of(cell: Cell) -> Mapping[str, Any]:
    """Return what stands in a cell, with the areas if they are what guards the human."""
    areas = cell.safety.areas.areas if cell.safety.policy == AREAS else ()
    return {
        "schema_version": SCENE_VERSION,
        "boxes": [_box(box) for box in cell.objects],
        "fixtures": [_box(box) for box in cell.fixtures],
        "areas": [
            {
                "name": area.name,
                "low": list(area.low),
                "high": list(area.high),
                "kind": "red" if area.scale == 0.0 else "orange",
                "agent": cell.robot.agent,
            }
            for area in areas
        ],
        "slots": [{"name": slot.name, "position": list(slot.position)} for slot in cell.slots],
    }


def _box(box: Box) -> dict[str, Any]:
    return {
        "name": box.name,
        "size": list(box.size),
        "position": list(box.position),
        "yaw": 0.0,
        "color": list(box.color),
    }
