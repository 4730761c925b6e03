"""What stands in a cell: boxes, tables, the floor areas of a safety policy and the places for objects; as JSON."""

from __future__ import annotations

import json
import reprlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, TypeVar, cast

from hrclog.json_text import parse_json

SCENE_VERSION: Final = 1
MAX_THINGS: Final = 1000

Vector = tuple[float, float, float]
Point2 = tuple[float, float]
Rgb = tuple[int, int, int]
AreaKind = Literal["red", "orange"]

FARTHEST_M: Final = 1e4
"""How far from the origin anything may be."""

QUATERNION_NORMS: Final = (1e-6, 1e6)
"""Between these lies the length of a quaternion that is a rotation; readers make it 1."""

_KINDS: Final = ("red", "orange")
_GREY: Final = (160, 160, 160)


@dataclass(frozen=True, slots=True)
class Box:
    """A box: size and the position of its centre in m, yaw about z in rad, colour of 0 to 255."""

    name: str
    size: Vector
    position: Vector
    yaw: float = 0.0
    color: Rgb = _GREY


@dataclass(frozen=True, slots=True)
class Area:
    """A rectangle of the floor, m, that a safety function watches for an agent ("": for all)."""

    name: str
    low: Point2
    high: Point2
    kind: AreaKind
    agent: str = ""


@dataclass(frozen=True, slots=True)
class Slot:
    """A place for an object; the position is the object's centre, m."""

    name: str
    position: Vector


@dataclass(frozen=True, slots=True)
class Base:
    """Where the root of an agent's robot description stands: m, yaw about z in rad. Default: at the world's origin."""

    name: str
    position: Vector
    yaw: float = 0.0


@dataclass(frozen=True, slots=True)
class Scene:
    """What stands in a cell, in world coordinates with z up; boxes can be moved, fixtures cannot."""

    boxes: tuple[Box, ...] = ()
    fixtures: tuple[Box, ...] = ()
    areas: tuple[Area, ...] = ()
    slots: tuple[Slot, ...] = ()
    bases: tuple[Base, ...] = ()


def scene_text(scene: Mapping[str, Any]) -> str:
    """Return a scene as JSON text.

    Raises:
        ValueError: it is no scene.
    """
    try:
        text = json.dumps(scene, ensure_ascii=False, allow_nan=False)
        text.encode()
    except (TypeError, ValueError, RecursionError) as error:
        raise ValueError(f"it is not JSON ({error})") from error
    _, problems = parse_scene(text)
    if problems:
        raise ValueError(problems[0])
    return text


def parse_scene(text: str) -> tuple[Scene, list[str]]:
    """Return the scene of a JSON text and what of it had to be left out; fields not known here are ignored."""
    try:
        value = parse_json(text)
    except ValueError as error:
        return Scene(), [f"it is not JSON ({str(error)[:80]}): {text[:40]!r}"]
    if not isinstance(value, Mapping):
        return Scene(), [f"found {reprlib.repr(value)}, expected a JSON object"]
    problems: list[str] = []
    version = value.get("schema_version")
    if version != SCENE_VERSION:
        problems.append(f"schema_version: found {reprlib.repr(version)}, expected {SCENE_VERSION}")
    scene = Scene(
        boxes=tuple(_things(value, "boxes", _box, problems)),
        fixtures=tuple(_things(value, "fixtures", _box, problems)),
        areas=tuple(_things(value, "areas", _area, problems)),
        slots=tuple(_things(value, "slots", _slot, problems)),
        bases=tuple(_things(value, "bases", _base, problems)),
    )
    return scene, problems


_Thing = TypeVar("_Thing", Box, Area, Slot, Base)


def _things(
    scene: Mapping[str, Any], kind: str, read: Callable[[Mapping[str, Any]], _Thing], problems: list[str]
) -> Iterator[_Thing]:
    entries = scene.get(kind, [])
    if not isinstance(entries, Sequence) or isinstance(entries, str):
        problems.append(f"{kind}: found {reprlib.repr(entries)}, expected a list")
        return
    if len(entries) > MAX_THINGS:
        problems.append(f"{kind}: found {len(entries)}, expected at most {MAX_THINGS}; the first are kept")
    names: set[str] = set()
    for index, entry in enumerate(entries[:MAX_THINGS]):
        try:
            if not isinstance(entry, Mapping):
                raise _value_error("entry", entry, "a JSON object")
            thing = read(entry)
            if thing.name in names:
                raise _value_error("name", thing.name, "one of its own")
        except ValueError as error:
            problems.append(f"{kind}[{index}]: {error}")
            continue
        names.add(thing.name)
        yield thing


def _box(entry: Mapping[str, Any]) -> Box:
    size = _vector(entry, "size")
    if min(size) <= 0:
        raise _value_error("size", size, "numbers above 0")
    yaw = _number("yaw", entry.get("yaw", 0.0))
    return Box(_name(entry), size, _vector(entry, "position"), yaw, _color(entry.get("color", _GREY)))


def _area(entry: Mapping[str, Any]) -> Area:
    low, high = (cast("Point2", _numbers(entry, side, 2)) for side in ("low", "high"))
    if low[0] >= high[0] or low[1] >= high[1]:
        raise _value_error("high", high, f"more than low, {low}")
    kind, agent = entry.get("kind"), entry.get("agent", "")
    if kind not in _KINDS:
        raise _value_error("kind", kind, " or ".join(_KINDS))
    if not isinstance(agent, str):
        raise _value_error("agent", agent, "a name")
    return Area(_name(entry), low, high, cast("AreaKind", kind), _text("agent", agent))


def _slot(entry: Mapping[str, Any]) -> Slot:
    return Slot(_name(entry), _vector(entry, "position"))


def _base(entry: Mapping[str, Any]) -> Base:
    return Base(_name(entry), _vector(entry, "position"), _number("yaw", entry.get("yaw", 0.0)))


def _name(entry: Mapping[str, Any]) -> str:
    name = entry.get("name")
    if not isinstance(name, str) or not name.strip():
        raise _value_error("name", name, "a text that is not empty")
    return _text("name", name)


def _text(what: str, text: str) -> str:
    try:
        text.encode()
    except UnicodeEncodeError as error:  # JSON can escape half of a surrogate pair
        raise _value_error(what, text, "valid Unicode") from error
    return text


def _vector(entry: Mapping[str, Any], name: str) -> Vector:
    return cast("Vector", _numbers(entry, name, 3))


def _numbers(entry: Mapping[str, Any], name: str, count: int) -> tuple[float, ...]:
    value = entry.get(name)
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != count:
        raise _value_error(name, value, f"{count} numbers")
    return tuple(_number(name, number) for number in value)


def _number(what: str, value: object) -> float:
    if not isinstance(value, int | float) or isinstance(value, bool) or not abs(value) <= FARTHEST_M:
        raise _value_error(what, value, f"a number within {FARTHEST_M:g} of 0")
    return float(value)


def _color(value: object) -> Rgb:
    is_triple = isinstance(value, Sequence) and len(value) == 3
    if not is_triple or not all(isinstance(part, int) and 0 <= part <= 255 for part in cast("Rgb", value)):
        raise _value_error("color", value, "3 whole numbers from 0 to 255")
    red, green, blue = cast("Rgb", value)
    return int(red), int(green), int(blue)


def _value_error(what: str, value: object, expected: str) -> ValueError:
    return ValueError(f"{what}: found {reprlib.repr(value)}, expected {expected}")
