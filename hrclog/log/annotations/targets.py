"""What a judgement of somebody is about: a whole run, an execution, or a span of time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final

from hrclog.errors import InvalidEventError
from hrclog.events import LATEST_NS
from hrclog.units import NS_PER_S

RUN_WORD: Final = "run"
SPAN_SIGN: Final = ".."
FORM: Final = (
    "run, the id of an execution, or FROM..TO (seconds from the run's start, or instants such as 2026-03-02T09:00:10Z)"
)
_MICROSECOND: Final = 1000


@dataclass(frozen=True, slots=True, eq=True)
class Target:
    """A run where nothing is set, else one of its executions, or a span of it.

    Attributes:
        execution_id: of the execution.
        from_ns: begin of the span, ns on the recorder's clock; None for that of the run.
        to_ns: its end; None for that of the run.
        is_span: whether it is a span.
    """

    execution_id: str = ""
    from_ns: int | None = None
    to_ns: int | None = None
    is_span: bool = False

    @property
    def is_run(self) -> bool:
        """Return whether it is the whole run."""
        return not (self.execution_id or self.is_span)

    def __str__(self) -> str:
        if self.is_run:
            return RUN_WORD
        if self.execution_id:
            return self.execution_id
        return SPAN_SIGN.join("" if end is None else _utc(end) for end in (self.from_ns, self.to_ns))

    def to_json(self) -> dict[str, Any]:
        """Return it as the details of an annotation hold it."""
        if self.is_run:
            return {"run": True}
        if self.execution_id:
            return {"execution": self.execution_id}
        return {"from_ns": self.from_ns, "to_ns": self.to_ns}


def target_from_json(value: object) -> Target | None:
    """Return a target, None for what is none."""
    if not isinstance(value, Mapping):
        return None
    if value.get("run") is True:
        return Target()
    execution = value.get("execution")
    if isinstance(execution, str) and execution:
        return Target(execution)
    ends = [value.get("from_ns"), value.get("to_ns")]
    if not ({"from_ns", "to_ns"} & set(value)) or any(not _is_instant(end) for end in ends):
        return None
    return Target("", ends[0], ends[1], is_span=True)


def parse_target(text: str, start_ns: int) -> Target:
    """Return what a user names.

    Args:
        text: `run`, an execution's id, or FROM..TO.
        start_ns: when the run began.

    Raises:
        InvalidEventError: it is none of these.
    """
    text = text.strip()
    if text == RUN_WORD:
        return Target()
    if SPAN_SIGN not in text:
        if not text:
            raise InvalidEventError(f"found {text!r}, expected {FORM}")
        return Target(text)
    begin, _, end = text.partition(SPAN_SIGN)
    from_ns, to_ns = (_instant(part, text, start_ns) for part in (begin, end))
    for part, instant in ((begin, from_ns), (end, to_ns)):
        if instant is not None and abs(instant) > LATEST_NS:
            raise InvalidEventError(f"found {part.strip()!r} in {text!r}, expected an instant between 1897 and 2043")
    if from_ns is not None and to_ns is not None and from_ns >= to_ns:
        raise InvalidEventError(f"found the span {text!r}, expected FROM before TO")
    return Target("", from_ns, to_ns, is_span=True)


def _instant(part: str, text: str, start_ns: int) -> int | None:
    part = part.strip()
    if not part:
        return None
    try:
        seconds = float(part)
    except ValueError:
        return _iso_ns(part, text)
    if not math.isfinite(seconds) or abs(seconds) * NS_PER_S > LATEST_NS:
        raise InvalidEventError(f"found {part!r} in {text!r}, expected seconds from the run's start")
    return start_ns + round(seconds * NS_PER_S)


def _iso_ns(part: str, text: str) -> int:
    try:
        instant = datetime.fromisoformat(part)
    except ValueError as error:
        raise InvalidEventError(f"found {part!r} in {text!r}, expected {FORM}") from error
    if instant.tzinfo is None:
        raise InvalidEventError(f"found {part!r} in {text!r}, expected a zone too, such as {part}Z")
    seconds = int(instant.replace(microsecond=0).timestamp())
    return seconds * NS_PER_S + instant.microsecond * _MICROSECOND


def _utc(time_ns: int) -> str:
    try:
        return datetime.fromtimestamp(time_ns / NS_PER_S, UTC).isoformat(timespec="milliseconds")
    except (OverflowError, ValueError, OSError):
        return f"{time_ns} ns"


def _is_instant(value: object) -> bool:
    return value is None or (isinstance(value, int) and not isinstance(value, bool) and abs(value) <= LATEST_NS)
