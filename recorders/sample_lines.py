"""What one JSON line of another program samples: signals, joints, a pose, what stands in the cell, how an agent looks.

`SAMPLE_KINDS` lists the kinds with their fields; each makes the message that `Recorder` makes of the same in Python.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from hrclog.errors import InvalidEventError
from hrclog.log.messages.json_rows import short
from hrclog.log.messages.recorded_scene import MAX_BYTES
from hrclog.recorders.line_fields import check_fields, finite_of, instant_of, number_of, text_of
from hrclog.scene import FARTHEST_M, QUATERNION_NORMS, scene_text
from hrclog.wording import counted

if TYPE_CHECKING:
    from hrclog.recorders.recorder import Recorder

_UPRIGHT: Final = (0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True, slots=True)
class Sample:
    """What a line samples at one instant, None for now.

    Attributes:
        kind: of `SAMPLE_KINDS`.
        time_ns: when.
        names: of the signals, the agent or the object.
        write: writes it.
        once: what may be told once per run, "" for what may be told again.
        bodies: names of the scene's boxes, if it is a scene; a pose's body is in `names`.
    """

    kind: str
    time_ns: int | None
    names: tuple[str, ...]
    write: Callable[[Recorder], None]
    once: str = ""
    bodies: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class SampleKind:
    """A kind of line that is a sample.

    Attributes:
        plural: how an acknowledgement names what was sampled.
        fields: that a line may have.
        read: makes the sample of a line and its instant.
    """

    plural: str
    fields: tuple[str, ...]
    read: Callable[[Mapping[str, Any], int | None], Sample]


def is_sample(value: Mapping[str, Any]) -> bool:
    """Return whether a line is a sample, not an event."""
    kind = value.get("kind")
    return isinstance(kind, str) and kind in SAMPLE_KINDS


def sample_of(value: Mapping[str, Any]) -> Sample:
    """Return the sample of a line that is one.

    Raises:
        InvalidEventError: a field is missing, unknown or of the wrong type.
    """
    name = value["kind"]
    kind = SAMPLE_KINDS[name]
    check_fields(value, kind.fields, name)
    return kind.read(value, instant_of(name, value))


def _signals(value: Mapping[str, Any], time_ns: int | None) -> Sample:
    """Read a `name` and a `value`, or `values` by their names."""
    if _has_values(value, "signal", "name", "value"):
        numbers = _by_name("signal", value["values"], number_of)
    else:
        name = text_of("signal", "name", value.get("name"))
        numbers = {name: number_of("signal", name, value.get("value"))}

    def write(recorder: Recorder) -> None:
        recorder.signals(numbers, time_ns=time_ns)

    return Sample("signal", time_ns, tuple(numbers), write)


def _joints(value: Mapping[str, Any], time_ns: int | None) -> Sample:
    """Read `names` and `positions` of an `agent`'s joints, or `values` by their names."""
    agent = text_of("joints", "agent", value.get("agent"))
    if _has_values(value, "joints", "names", "positions"):
        positions = _by_name("joints", value["values"], finite_of)
    else:
        names, given = (_list("joints", field, value.get(field)) for field in ("names", "positions"))
        if len(names) != len(given) or not names:
            counts = f"{counted(len(names), 'name')} and {counted(len(given), 'position')}"
            raise InvalidEventError(f"joints: found {counts}, expected as many, and one at least")
        positions = {
            text_of("joints", "a name", name): finite_of("joints", name, position)
            for name, position in zip(names, given, strict=True)
        }
        if len(positions) != len(names):
            raise InvalidEventError(f"joints: found a name twice in {short(names)}, expected each once")
    numbers = tuple(positions.values())

    def write(recorder: Recorder) -> None:
        recorder.joints(agent, tuple(positions), numbers, time_ns=time_ns)

    return Sample("joints", time_ns, (agent,), write)


def _pose(value: Mapping[str, Any], time_ns: int | None) -> Sample:
    """Read the `name` of an object, the `position` of its centre, and its `quaternion` or `yaw`."""
    name = text_of("pose", "name", value.get("name"))
    position = _vector("pose", "position", value.get("position"), 3)
    if max(map(abs, position)) > FARTHEST_M:
        raise InvalidEventError(f"pose: position is {position}, expected m within {FARTHEST_M:g} of 0")
    quaternion = _rotation(value)

    def write(recorder: Recorder) -> None:
        recorder.pose(name, position, quaternion, time_ns=time_ns)

    return Sample("pose", time_ns, (name,), write)


def _rotation(value: Mapping[str, Any]) -> tuple[float, ...]:
    """Return the quaternion of a pose: x, y, z, w."""
    if "quaternion" in value and "yaw" in value:
        raise InvalidEventError("pose: found quaternion and yaw, expected one of them")
    if "yaw" in value:
        yaw = finite_of("pose", "yaw", value["yaw"])
        return (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)) if yaw else _UPRIGHT
    if "quaternion" not in value:
        return _UPRIGHT
    quaternion = _vector("pose", "quaternion", value["quaternion"], 4)
    least, most = QUATERNION_NORMS
    if not least < math.hypot(*quaternion) < most:
        text = f"pose: quaternion is {quaternion}, expected x, y, z, w of length 1"
        raise InvalidEventError(f"{text}; leave it out for no rotation")
    return quaternion


def _scene(value: Mapping[str, Any], time_ns: int | None) -> Sample:
    """Read a `scene`: docs/log-format.md says what it may hold."""
    scene = value.get("scene")
    if not isinstance(scene, Mapping):
        raise InvalidEventError(f"scene: scene is {short(scene)}, expected a JSON object, see docs/log-format.md")
    try:
        _check_size("scene", scene_text(scene))
    except ValueError as error:
        raise InvalidEventError(f"scene: {error}") from error
    bodies = tuple(box["name"] for box in scene.get("boxes", ()))

    def write(recorder: Recorder) -> None:
        recorder.scene(scene, time_ns=time_ns)

    return Sample("scene", time_ns, (), write, "the scene", bodies)


def _description(value: Mapping[str, Any], time_ns: int | None) -> Sample:
    """Read the `urdf` of an `agent`."""
    agent = text_of("description", "agent", value.get("agent"))
    urdf = text_of("description", "urdf", value.get("urdf"))
    if not urdf.lstrip("\ufeff \t\r\n").startswith("<"):
        raise InvalidEventError(f"description: urdf is {short(urdf)}, expected the text of a URDF, not its place")
    _check_size("description", urdf)
    once = f"the description of {short(agent)}"

    def write(recorder: Recorder) -> None:
        recorder.describe(agent, urdf, time_ns=time_ns)

    return Sample("description", time_ns, (agent,), write, once)


SAMPLE_KINDS: Final[Mapping[str, SampleKind]] = {
    "signal": SampleKind("signals", ("kind", "name", "value", "values", "time_ns"), _signals),
    "joints": SampleKind("joints", ("kind", "agent", "names", "positions", "values", "time_ns"), _joints),
    "pose": SampleKind("poses", ("kind", "name", "position", "quaternion", "yaw", "time_ns"), _pose),
    "scene": SampleKind("scenes", ("kind", "scene", "time_ns"), _scene),
    "description": SampleKind("descriptions", ("kind", "agent", "urdf", "time_ns"), _description),
}
"""Kinds of lines that are samples, not events."""


def _has_values(value: Mapping[str, Any], kind: str, first: str, second: str) -> bool:
    """Return whether a line has `values` by name, not two fields instead; raise if it has both, or neither."""
    has_values = "values" in value
    if has_values == (first in value or second in value):
        names = ", ".join(name for name in (first, second, "values") if name in value) or "neither"
        raise InvalidEventError(f"{kind}: found {names}, expected {first} and {second}, or values by name")
    return has_values


def _by_name(kind: str, values: object, number: Callable[[str, object, object], float]) -> dict[str, float]:
    if not isinstance(values, Mapping) or not values:
        raise InvalidEventError(f"{kind}: values is {short(values)}, expected an object of numbers by name")
    return {text_of(kind, "name", name): number(kind, name, value) for name, value in values.items()}


def _list(kind: str, field: str, value: object) -> Sequence[object]:
    if not isinstance(value, list):
        raise InvalidEventError(f"{kind}: {field} is {short(value)}, expected a list")
    return value


def _vector(kind: str, field: str, value: object, count: int) -> tuple[float, ...]:
    if not isinstance(value, list) or len(value) != count:
        raise InvalidEventError(f"{kind}: {field} is {short(value)}, expected {count} numbers")
    return tuple(finite_of(kind, field, number) for number in value)


def _check_size(kind: str, text: str) -> None:
    """Raise if a text is longer than what is read."""
    size = len(text.encode())
    if size > MAX_BYTES:
        raise InvalidEventError(f"{kind}: found {size} bytes, expected at most {MAX_BYTES}")
