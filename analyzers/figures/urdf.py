"""Robot descriptions that can be drawn: one tree of links, without geometry from other files."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import Final
from xml.etree import ElementTree as ET

from hrclog.wording import counted

MAX_LINKS: Final = 300

_MOVING: Final = ("revolute", "continuous", "prismatic")
_SHAPES: Final = ("box", "cylinder", "sphere", "capsule")
_NUMBERS: Final = ("xyz", "rpy", "size", "radius", "length")
_FARTHEST: Final = 1e4
_ZERO: Final = "0 0 0"


@dataclass(frozen=True, slots=True)
class Urdf:
    """A valid description: its text, its root link, its moving joints, and what was left out."""

    text: str
    root: str
    joints: tuple[str, ...]
    left_out: tuple[str, ...] = ()


def drawable(text: str, name: str) -> Urdf:
    """Return a description under another name, without collision shapes and other parts that cannot be drawn.

    Args:
        text: URDF.
        name: of the robot in the result.

    Raises:
        ValueError: it is no description of one tree of links.
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ValueError("it declares entities, expected plain URDF")
    try:
        source = ET.fromstring(text)  # noqa: S314 - entities are refused above
    except ET.ParseError as error:
        raise ValueError(f"it is not XML ({error})") from error
    if source.tag != "robot":
        raise ValueError(f"its element is {source.tag!r}, expected 'robot'")
    links, joints = source.findall("link"), source.findall("joint")
    root = _find_root(links, joints)
    left_out: Counter[str] = Counter()
    robot = ET.Element("robot", name=name)
    robot.extend([material for material in source.findall("material") if _is_color(material)])
    robot.extend([_link(link, left_out) for link in links])
    robot.extend([_joint(joint, left_out) for joint in joints])
    moving = tuple(joint.get("name", "") for joint in robot.findall("joint") if joint.get("type") in _MOVING)
    omissions = tuple(f"{count} {kind}" for kind, count in sorted(left_out.items()))
    return Urdf(ET.tostring(robot, encoding="unicode"), root, moving, omissions)


def _find_root(links: list[ET.Element], joints: list[ET.Element]) -> str:
    """Return the root of the tree of links: the link that no joint moves.

    Raises:
        ValueError: the links and joints are no tree.
    """
    names = [link.get("name", "") for link in links]
    if not 0 < len(names) <= MAX_LINKS:
        raise ValueError(f"it has {len(names)} links, expected 1 to {MAX_LINKS}")
    _check_unique("link", names)
    _check_unique("joint", [joint.get("name", "") for joint in joints])
    parents: dict[str, str] = {}
    for joint in joints:
        parent, child = (_end_link(joint, side) for side in ("parent", "child"))
        if parent not in names or child not in names or child in parents:
            raise ValueError(f"joint {joint.get('name')!r} does not lead from one of its links to another")
        parents[child] = parent
    roots = [name for name in names if name not in parents]
    if len(roots) != 1 or not all(_leads_to_root(name, roots[0], parents) for name in names):
        raise ValueError(f"its links are no tree: {counted(len(roots), 'of them has', 'of them have')} no parent")
    return roots[0]


def _leads_to_root(name: str, root: str, parents: dict[str, str]) -> bool:
    for _ in range(len(parents) + 1):
        if name == root:
            return True
        name = parents[name]
    return False


def _end_link(joint: ET.Element, side: str) -> str:
    element = joint.find(side)
    return "" if element is None else element.get("link", "")


def _check_unique(element: str, names: list[str]) -> None:
    if not all(names) or len(set(names)) < len(names):
        raise ValueError(f"a {element} has no name, or that of another {element}")


def _link(link: ET.Element, left_out: Counter[str]) -> ET.Element:
    result = ET.Element("link", name=link.get("name", ""))
    for visual in link.findall("visual"):
        shapes = visual.findall("geometry/*")
        kind = shapes[0].tag if len(shapes) == 1 else "unknown"
        if kind not in _SHAPES or not _is_shape(shapes[0]):
            left_out[f"shapes of kind {kind!r}"[:60]] += 1
            continue
        drawn_visual = ET.SubElement(result, "visual")
        _copy_origin(visual.find("origin"), drawn_visual)
        geometry = ET.SubElement(drawn_visual, "geometry")
        geometry.append(ET.Element(kind, _numeric_attributes(shapes[0])))
        material = visual.find("material")
        if material is not None and _is_color(material):
            drawn_visual.append(material)
    return result


def _joint(joint: ET.Element, left_out: Counter[str]) -> ET.Element:
    kind = joint.get("type", "")
    axis = joint.find("axis")
    if kind not in (*_MOVING, "fixed"):
        left_out[f"joints of kind {kind!r}"[:60]] += 1
        kind = "fixed"
    result = ET.Element("joint", name=joint.get("name", ""), type=kind)
    for side in ("parent", "child"):
        ET.SubElement(result, side, link=_end_link(joint, side))
    _copy_origin(joint.find("origin"), result)
    if kind != "fixed":
        xyz = _numeric_attributes(axis).get("xyz", "1 0 0") if axis is not None else "1 0 0"
        if not any(_floats(xyz)):
            raise ValueError(f"joint {joint.get('name')!r} has the axis {xyz!r}, expected a direction")
        ET.SubElement(result, "axis", xyz=xyz)
        ET.SubElement(result, "limit", lower="-1e4", upper="1e4", effort="1", velocity="1")  # positions are as logged
    return result


def _copy_origin(origin: ET.Element | None, into: ET.Element) -> None:
    if origin is not None:
        ET.SubElement(into, "origin", {"xyz": _ZERO, "rpy": _ZERO} | _numeric_attributes(origin))


def _is_shape(shape: ET.Element) -> bool:
    sizes = [_floats(shape.get(name, "")) for name in _SIZES[shape.tag]]
    expected = [3] if shape.tag == "box" else [1] * len(sizes)
    return [len(size) for size in sizes] == expected and all(
        0 < number <= _FARTHEST for size in sizes for number in size
    )


_SIZES: Final = {
    "box": ("size",),
    "cylinder": ("radius", "length"),
    "sphere": ("radius",),
    "capsule": ("radius", "length"),
}


def _is_color(material: ET.Element) -> bool:
    color = material.find("color")
    if color is None or not material.get("name"):
        return color is None and bool(material.get("name")) and material.find("texture") is None
    rgba = _floats(color.get("rgba", ""))
    return len(rgba) == 4 and all(0 <= part <= 1 for part in rgba) and material.find("texture") is None


def _numeric_attributes(element: ET.Element) -> dict[str, str]:
    """Return the attributes that hold numbers.

    Raises:
        ValueError: they do not.
    """
    numeric = {name: text for name, text in element.attrib.items() if name in _NUMBERS}
    for name, text in numeric.items():
        numbers = _floats(text)
        if not numbers or (name in ("xyz", "rpy", "size") and len(numbers) != 3):
            raise ValueError(f"it says {name}={text[:40]!r}, expected numbers within {_FARTHEST:g} of 0")
    return numeric


def _floats(text: str) -> list[float]:
    """Return the numbers of a text, [] if a word is no number or out of range."""
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        return []
    return numbers if all(math.isfinite(number) and abs(number) <= _FARTHEST for number in numbers) else []
