"""A small cell: an arm of two boxes, a cube, a table and the floor areas of a safety function."""

from __future__ import annotations

from typing import Any, Final

ARM_URDF: Final = """<?xml version="1.0"?>
<robot name="arm">
  <material name="blue"><color rgba="0.2 0.4 0.8 1"/></material>
  <link name="base">
    <visual><origin xyz="0 0 0.25"/><geometry><box size="0.3 0.3 0.5"/></geometry><material name="blue"/></visual>
    <collision><geometry><box size="0.3 0.3 0.5"/></geometry></collision>
  </link>
  <link name="boom">
    <visual><origin xyz="0.4 0 0"/><geometry><box size="0.8 0.1 0.1"/></geometry></visual>
  </link>
  <joint name="turn" type="revolute">
    <parent link="base"/><child link="boom"/><origin xyz="0 0 0.55"/><axis xyz="0 0 1"/>
    <limit lower="-3.2" upper="3.2" effort="1" velocity="1"/>
  </joint>
</robot>
"""


def cell_scene() -> dict[str, Any]:
    """Return a scene with one cube, one table and two areas of the robot."""
    return {
        "schema_version": 1,
        "boxes": [
            {"name": "cube", "size": [0.1, 0.1, 0.1], "position": [0.8, 0, 0.55], "yaw": 0, "color": [0, 0, 255]}
        ],
        "fixtures": [{"name": "table", "size": [1, 1, 0.5], "position": [1, 0, 0.25], "color": [120, 90, 60]}],
        "areas": [
            {"name": "near", "low": [-1, -1], "high": [1, 1], "kind": "red", "agent": "robot"},
            {"name": "far", "low": [-2, -2], "high": [2, 2], "kind": "orange", "agent": "robot"},
        ],
        "bases": [{"name": "robot", "position": [0, -0.5, 0], "yaw": 1.5}],
        "slots": [{"name": "slot 1", "position": [1.2, 0.2, 0.55]}],
    }
