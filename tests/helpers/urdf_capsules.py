"""The capsules of a body as its URDF has them, to compare with those that PyBullet takes distances between."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from hrclog.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Capsule:
    """All points within `radius` of a segment.

    Args:
        link: PyBullet's index of the link; a link has the index of the joint that moves it.
        link_name: its name.
        radius: in m.
        a: an end of the segment in the link's frame, in m, shape (3,).
        b: the other end.
    """

    link: int
    link_name: str
    radius: float
    a: FloatArray
    b: FloatArray


def capsules(urdf_path: Path) -> list[Capsule]:
    """Return the collision capsules of a body, in the order of its URDF.

    Args:
        urdf_path: one of `hrclog.sim.models`; its collision elements are all capsules.
    """
    root = ET.parse(urdf_path).getroot()  # noqa: S314 - a file of this package
    index = {_find(joint, "child").get("link", ""): number for number, joint in enumerate(root.findall("joint"))}
    found = []
    for link in root.findall("link"):
        name = link.get("name", "")
        for collision in link.findall("collision"):
            shape = _find(collision, "geometry/capsule")
            origin = _find(collision, "origin")
            middle, angles = _numbers(origin, "xyz"), _numbers(origin, "rpy")
            half = _z_axis(angles) * float(shape.get("length", "nan")) / 2
            radius = float(shape.get("radius", "nan"))
            found.append(Capsule(index.get(name, -1), name, radius, middle - half, middle + half))
    return found


def _find(element: ET.Element, path: str) -> ET.Element:
    found = element.find(path)
    if found is None:
        raise ValueError(f"<{element.tag} name={element.get('name')!r}> has no <{path}>")
    return found


def _numbers(element: ET.Element, attribute: str) -> FloatArray:
    return np.array([float(number) for number in element.get(attribute, "0 0 0").split()])


def _z_axis(angles: FloatArray) -> FloatArray:
    """Return where roll, pitch and yaw (about fixed axes, in this order) turn z."""
    roll, pitch, yaw = angles.tolist()
    along, across = math.cos(roll) * math.sin(pitch), math.sin(roll)
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([c * along + s * across, s * along - c * across, math.cos(roll) * math.cos(pitch)])
