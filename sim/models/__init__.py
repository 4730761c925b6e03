"""The bodies of the simulated cell as URDF files."""

from __future__ import annotations

from pathlib import Path
from typing import Final

ROBOT_URDF: Final = Path(__file__).parent / "robot.urdf"
"""`RailArm()` in the frame of its rail: its root stands at (0, rail_y, base_z), and a yaw of the arm's base is added to
the joint shoulder_pan. Links 0 to 7 are the carriage, what joints 1 to 6 move, and the gripper, whose frame is the
tip's."""

HUMAN_URDF: Final = Path(__file__).parent / "human.urdf"
"""A person whose root stands at the origin of the world. Joints 0 to 12: `hrclog.sim.cell.human_kinematics`."""
