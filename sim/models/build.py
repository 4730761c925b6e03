"""Write the URDF files of the robot and the human from the numbers their kinematics use.

`python -m hrclog.sim.models.build` writes both anew.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final
from xml.etree import ElementTree as ET

from hrclog.sim.cell.human_kinematics import (
    FOREARM_M,
    HAND_M,
    HIP_HEIGHT_M,
    HUMAN_JOINT_NAMES,
    HUMAN_LOWER,
    HUMAN_UPPER,
    NECK_RISE_M,
    SHOULDER_HALF_WIDTH_M,
    SHOULDER_RISE_M,
    UPPER_ARM_M,
)
from hrclog.sim.cell.robot_kinematics import DH_A, DH_ALPHA, DH_D, JOINT_NAMES, RailArm
from hrclog.sim.models import HUMAN_URDF, ROBOT_URDF

Vector = tuple[float, float, float]

ZERO: Final = (0.0, 0.0, 0.0)
FORWARD: Final = (1.0, 0.0, 0.0)
LEFT: Final = (0.0, 1.0, 0.0)
RIGHT: Final = (0.0, -1.0, 0.0)
UP: Final = (0.0, 0.0, 1.0)

STEEL: Final = (0.45, 0.48, 0.52)
BLUE: Final = (0.36, 0.55, 0.72)
SLATE: Final = (0.50, 0.56, 0.64)
DARK: Final = (0.32, 0.34, 0.38)
TROUSERS: Final = (0.34, 0.40, 0.52)
SHIRT: Final = (0.47, 0.60, 0.45)
SLEEVE: Final = (0.42, 0.54, 0.41)
SKIN: Final = (0.80, 0.62, 0.50)


@dataclass(frozen=True)
class Part:
    """A capsule on a link, seen and, if solid, felt; its ends in the link's frame, in m."""

    radius: float
    a: Vector
    b: Vector
    solid: bool = True


@dataclass(frozen=True)
class Box:
    """A box on a link that is only seen; in m."""

    size: Vector
    middle: Vector


@dataclass(frozen=True)
class Link:
    """A link, its colour and its shapes."""

    name: str
    colour: Vector
    shapes: tuple[Part | Box, ...] = ()


@dataclass(frozen=True)
class Joint:
    """How a link hangs on another: the frame of the joint in the other link's frame, in m and rad."""

    name: str
    kind: str
    xyz: Vector
    rpy: Vector = ZERO
    axis: Vector = UP
    lower: float = 0.0
    upper: float = 0.0
    velocity: float = 10.0


def robot_urdf(arm: RailArm) -> str:
    """Return the URDF of an arm, see `hrclog.sim.models.ROBOT_URDF`; only its tip and its limits are looked at.

    A link turns about z of its own frame, which is the Denavit-Hartenberg frame before its joint, turned by the joint.
    """
    travel = arm.upper[0] - arm.lower[0]
    beam = Box((travel + 0.4, 0.14, 0.10), ((arm.lower[0] + arm.upper[0]) / 2, 0.0, -0.20))
    links = [
        Link("rail_beam", STEEL, (beam,)),
        Link("carriage", DARK, (Part(0.07, (-0.08, 0.0, -0.08), (0.08, 0.0, -0.08)),)),
        Link("shoulder", BLUE, (Part(0.06, (0.0, 0.0, 0.02), (0.0, 0.0, DH_D[0])),)),
        Link(
            "upper_arm",
            SLATE,
            (
                Part(0.055, (0.0, 0.0, 0.136), (DH_A[1], 0.0, 0.136)),
                Part(0.055, ZERO, (0.0, 0.0, 0.136), solid=False),
            ),
        ),
        Link(
            "forearm",
            BLUE,
            (
                Part(0.045, (0.0, 0.0, 0.0165), (DH_A[2], 0.0, 0.0165)),
                Part(0.045, (0.0, 0.0, 0.0165), (0.0, 0.0, 0.12), solid=False),
            ),
        ),
        Link("wrist_1", SLATE, (Part(0.04, (0.0, 0.0, 0.0165), (0.0, 0.0, DH_D[3])),)),
        Link("wrist_2", BLUE, (Part(0.04, ZERO, (0.0, 0.0, DH_D[4])),)),
        Link("wrist_3", SLATE, (Part(0.038, ZERO, (0.0, 0.0, DH_D[5] - 0.02)),)),
        Link("gripper", DARK, _gripper(arm.tip_m)),
    ]
    limits = list(zip(arm.lower, arm.upper, arm.max_velocity, strict=True))
    joints = [Joint(JOINT_NAMES[0], "prismatic", ZERO, ZERO, FORWARD, *limits[0])]
    a, d, alpha = (0.0, *DH_A), (0.0, *DH_D), (0.0, *DH_ALPHA)
    joints += [
        Joint(name, "revolute", (a[number], 0.0, d[number]), (alpha[number], 0.0, 0.0), UP, *limits[number + 1])
        for number, name in enumerate(JOINT_NAMES[1:])
    ]
    joints.append(Joint("tip", "fixed", (a[6], 0.0, d[6] + arm.tip_m), (alpha[6], 0.0, 0.0)))
    return _urdf_text("robot", links, joints, list(range(len(joints))))


def human_urdf() -> str:
    """Return the URDF of a person in the world's frame."""
    links = [
        Link("floor", STEEL),
        Link("walk_x", STEEL),
        Link("walk_y", STEEL),
        Link(
            "pelvis",
            TROUSERS,
            (
                Part(0.11, (0.0, -0.08, 0.0), (0.0, 0.08, 0.0)),
                Part(0.07, (0.0, 0.09, -0.05), (0.0, 0.09, 0.07 - HIP_HEIGHT_M)),
                Part(0.07, (0.0, -0.09, -0.05), (0.0, -0.09, 0.07 - HIP_HEIGHT_M)),
            ),
        ),
        Link(
            "torso",
            SHIRT,
            (
                Part(0.13, (0.0, 0.0, 0.08), (0.0, 0.0, 0.36)),
                Part(0.07, (0.0, -0.14, 0.45), (0.0, 0.14, 0.45)),
            ),
        ),
        Link("head", SKIN, (Part(0.10, (0.0, 0.0, 0.13), (0.0, 0.0, 0.19)),)),
    ]
    places = [
        (ZERO, FORWARD),
        (ZERO, LEFT),
        ((0.0, 0.0, HIP_HEIGHT_M), UP),
        (ZERO, LEFT),
        ((0.0, 0.0, NECK_RISE_M), LEFT),
    ]
    parents = [0, 1, 2, 3, 4]
    for side, offset in (("left", SHOULDER_HALF_WIDTH_M), ("right", -SHOULDER_HALF_WIDTH_M)):
        first = len(links)
        links += [
            Link(f"{side}_shoulder", SHIRT),
            Link(f"{side}_upper_arm", SLEEVE, (Part(0.05, ZERO, (0.0, 0.0, -UPPER_ARM_M)),)),
            Link(f"{side}_forearm", SKIN, (Part(0.04, ZERO, (0.0, 0.0, -FOREARM_M)),)),
            Link(f"{side}_hand", SKIN, (Part(0.035, (0.0, 0.0, -0.03), (0.0, 0.0, 0.035 - HAND_M)),)),
        ]
        places += [
            ((0.0, offset, SHOULDER_RISE_M), UP),
            (ZERO, RIGHT),
            ((0.0, 0.0, -UPPER_ARM_M), RIGHT),
            ((0.0, 0.0, -FOREARM_M), RIGHT),
        ]
        parents += [4, first, first + 1, first + 2]
    kinds = ["prismatic", "prismatic", "continuous", *["revolute"] * 10]
    joints = [
        Joint(name, kind, xyz, ZERO, axis, lower, upper)
        for name, kind, (xyz, axis), lower, upper in zip(
            HUMAN_JOINT_NAMES, kinds, places, HUMAN_LOWER, HUMAN_UPPER, strict=True
        )
    ]
    return _urdf_text("human", links, joints, parents)


def write() -> None:
    """Write both files."""
    ROBOT_URDF.write_text(robot_urdf(RailArm()), encoding="utf-8")
    HUMAN_URDF.write_text(human_urdf(), encoding="utf-8")


def _gripper(tip_m: float) -> tuple[Part, ...]:
    """Return a palm and two fingers that are seen, and the capsule around them that is felt; z = 0 is the tip."""
    palm = -min(0.09, tip_m)
    around = 0.045
    return (
        Part(around, (0.0, 0.0, palm - 0.015), (0.0, 0.0, -around)),
        Part(0.035, (0.0, -0.02, palm), (0.0, 0.02, palm), solid=False),
        Part(0.03, (0.0, 0.0, -tip_m), (0.0, 0.0, palm), solid=False),
        Part(0.01, (0.0, -0.038, palm), (0.0, -0.038, -0.01), solid=False),
        Part(0.01, (0.0, 0.038, palm), (0.0, 0.038, -0.01), solid=False),
    )


def _urdf_text(name: str, links: list[Link], joints: list[Joint], parents: list[int]) -> str:
    """Return a URDF in which joint i moves link i + 1, so that PyBullet's indices are those of the joints."""
    root = ET.Element("robot", name=name)
    root.append(ET.Comment(" made by hrclog.sim.models.build "))
    for link in links:
        root.append(_link_element(link))
    for joint, parent, child in zip(joints, parents, links[1:], strict=True):
        root.append(_joint_element(joint, links[parent].name, child.name))
    ET.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _link_element(link: Link) -> ET.Element:
    element = ET.Element("link", name=link.name)
    inertial = ET.SubElement(element, "inertial")
    ET.SubElement(inertial, "mass", value="1")
    ET.SubElement(inertial, "inertia", ixx="0.01", ixy="0", ixz="0", iyy="0.01", iyz="0", izz="0.01")
    for shape in link.shapes:
        for geometry, middle, angles in _visual_shapes(shape):
            visual = _add_shape(element, "visual", geometry, middle, angles)
            material = ET.SubElement(visual, "material", name=link.name)
            ET.SubElement(material, "color", rgba=_numbers_text(*link.colour, 1.0))
    for shape in link.shapes:
        if isinstance(shape, Part) and shape.solid:
            length, middle, angles = _segment_pose(shape)
            capsule = ET.Element("capsule", radius=_numbers_text(shape.radius), length=_numbers_text(length))
            _add_shape(element, "collision", capsule, middle, angles)
    return element


def _visual_shapes(shape: Part | Box) -> list[tuple[ET.Element, Vector, Vector]]:
    """Return what draws a shape; not every viewer knows capsules."""
    if isinstance(shape, Box):
        return [(ET.Element("box", size=_numbers_text(*shape.size)), shape.middle, ZERO)]
    length, middle, angles = _segment_pose(shape)
    radius = _numbers_text(shape.radius)
    cylinder = ET.Element("cylinder", radius=radius, length=_numbers_text(length))
    ends = [(ET.Element("sphere", radius=radius), end, ZERO) for end in (shape.a, shape.b)]
    return [(cylinder, middle, angles), *ends]


def _segment_pose(part: Part) -> tuple[float, Vector, Vector]:
    """Return the length and middle of a capsule's segment, and the angles that turn z along it."""
    dx, dy, dz = (b - a for a, b in zip(part.a, part.b, strict=True))
    length = math.hypot(dx, dy, dz)
    x, y, z = ((a + b) / 2 for a, b in zip(part.a, part.b, strict=True))
    return length, (x, y, z), (0.0, math.atan2(math.hypot(dx, dy), dz), math.atan2(dy, dx))


def _add_shape(link: ET.Element, tag: str, shape: ET.Element, middle: Vector, angles: Vector) -> ET.Element:
    element = ET.SubElement(link, tag)
    ET.SubElement(element, "origin", xyz=_numbers_text(*middle), rpy=_numbers_text(*angles))
    ET.SubElement(element, "geometry").append(shape)
    return element


def _joint_element(joint: Joint, parent: str, child: str) -> ET.Element:
    element = ET.Element("joint", name=joint.name, type=joint.kind)
    ET.SubElement(element, "parent", link=parent)
    ET.SubElement(element, "child", link=child)
    ET.SubElement(element, "origin", xyz=_numbers_text(*joint.xyz), rpy=_numbers_text(*joint.rpy))
    if joint.kind != "fixed":
        ET.SubElement(element, "axis", xyz=_numbers_text(*joint.axis))
    if joint.kind in {"prismatic", "revolute"}:
        lower, upper, velocity = (_numbers_text(number) for number in (joint.lower, joint.upper, joint.velocity))
        ET.SubElement(element, "limit", lower=lower, upper=upper, velocity=velocity, effort="100")
    return element


def _numbers_text(*numbers: float) -> str:
    return " ".join(f"{round(number, 12) + 0.0:.12g}" for number in numbers)


if __name__ == "__main__":
    write()
