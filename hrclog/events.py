"""The event vocabulary: one typed class a kind.

Every event is a fact in the past tense. A class names just the fields that mean something for its kind;
`hrclog.event_rows` lays them out as the flat columns of `hrclog_msgs/msg/TaskEvent`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, ClassVar, Final, TypeVar

EVENT_VERSION: Final = 1

INT_COLUMNS: Final = ("time_ns", "agent_time_ns", "planned_start_ns", "planned_end_ns")
FLOAT_COLUMNS: Final = ("planned_duration_s", "planning_time_s", "path_length", "speed_scale")
STRING_COLUMNS: Final = (
    "kind",
    "run_id",
    "agent",
    "task",
    "task_type",
    "role",
    "execution_id",
    "parent_execution_id",
    "item_id",
    "command_id",
    "outcome",
    "reason",
    "cause",
    "mode",
    "zone",
    "target",
    "details",
)
COLUMNS: Final = ("schema_version", "attempt", "seq", *INT_COLUMNS, *FLOAT_COLUMNS, *STRING_COLUMNS)
"""The flat columns of an event, in wire order. Unset integers and floats are None, unset strings ""."""

LATEST_NS: Final = 2**61
"""Instants lie within this of 1970 (73 years), so that sums and differences stay within int64."""

CLOCK_SHIFT: Final = "clock_shift_ns"
"""Detail of a `run_started`: by how much the recorder's clock was behind the run's last event when the run went on."""

UNKNOWN_OUTCOME: Final = "unknown"
"""Outcome that a reader derives for an execution that is still open at the end of its log, or that does not tell how it
ended; never written."""

NOT_LEARNT: Final = "not_learnt"
"""Role that a reader derives for an execution that annotations say nothing is to be learnt from: it counts in
timelines, in metrics and as a disturbance of others; never written."""

COMPLETED: Final = "completed"
"""Outcome that a reader derives for an execution that ended in a run that tells no outcome at all; never written."""

OUTCOME_NOT_TOLD: Final = "outcome_not_told"
"""Detail of a `task_ended` without outcome whose source tells outcomes, but not this one: what it says instead."""


class Outcome(StrEnum):
    """How an execution or a run ended; ROS 2's words, with ABORTED mapped to failed."""

    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELED = "canceled"
    SKIPPED = "skipped"
    TIMED_OUT = "timed_out"


class Cause(StrEnum):
    """Why an execution paused."""

    SAFETY = "safety"
    OPERATOR = "operator"
    DEPENDENCY = "dependency"


class Role(StrEnum):
    """Whether an execution counts in durations and synergies, or only in timelines and metrics."""

    PRIMARY = "primary"
    AUXILIARY = "auxiliary"


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """A fact, and when it happened on the recorder's clock.

    `seq` counts the events of a run from 0; `agent_time_ns` is the same instant on the agent's own clock.
    """

    kind: ClassVar[str] = ""
    time_ns: int
    run_id: str = ""
    seq: int = 0
    agent_time_ns: int | None = None
    details: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunStarted(Event):
    """A run, or with `segment` > 1 its continuation after a stop, began."""

    kind: ClassVar[str] = "run_started"
    name: str = ""
    agents: tuple[str, ...] = ()
    plan: Any = None
    task_properties: Any = None
    dispatch_mode: str = ""
    software: Mapping[str, str] = field(default_factory=dict)
    seed: int | None = None
    segment: int = 1
    tags: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunEnded(Event):
    """A run came to its end."""

    kind: ClassVar[str] = "run_ended"
    outcome: str = Outcome.SUCCEEDED
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskFact(Event):
    """What all events of one execution carry; one `execution_id` per attempt, retries share `item_id`."""

    agent: str
    task: str
    execution_id: str
    task_type: str = ""
    role: str = Role.PRIMARY
    attempt: int = 1
    item_id: str = ""
    command_id: str = ""
    parent_execution_id: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskDispatched(TaskFact):
    """A task was handed to its agent."""

    kind: ClassVar[str] = "task_dispatched"
    planned_start_ns: int | None = None
    planned_end_ns: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskStarted(TaskFact):
    """An agent began an execution; planned instants are on the recorder's clock."""

    kind: ClassVar[str] = "task_started"
    planned_start_ns: int | None = None
    planned_end_ns: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskEnded(TaskFact):
    """An execution ended."""

    kind: ClassVar[str] = "task_ended"
    outcome: str = Outcome.SUCCEEDED
    reason: str = ""
    planned_duration_s: float | None = None
    planning_time_s: float | None = None
    path_length: float | None = None
    target: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskPaused(TaskFact):
    """An execution was halted for a while."""

    kind: ClassVar[str] = "task_paused"
    cause: str = Cause.OPERATOR
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskResumed(TaskFact):
    """A halted execution went on."""

    kind: ClassVar[str] = "task_resumed"
    cause: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandRejected(Event):
    """A command was refused, and why."""

    kind: ClassVar[str] = "command_rejected"
    command_id: str = ""
    execution_id: str = ""
    agent: str = ""
    task: str = ""
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class SafetyStateChanged(Event):
    """The safety function changed an agent's mode or speed scale (0 stopped .. 1 full speed)."""

    kind: ClassVar[str] = "safety_state_changed"
    agent: str = ""
    mode: str = ""
    speed_scale: float | None = None
    zone: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockSynced(Event):
    """An agent's clock read `agent_time_ns` when the recorder's read `time_ns`."""

    kind: ClassVar[str] = "clock_synced"
    agent: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanChanged(Event):
    """The plan being followed was replaced."""

    kind: ClassVar[str] = "plan_changed"
    plan: Any = None
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class AnnotationAdded(Event):
    """Somebody said something about the run or one execution; the text is in `reason`."""

    kind: ClassVar[str] = "annotation_added"
    execution_id: str = ""
    agent: str = ""
    task: str = ""
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class StatisticsUpdated(Event):
    """The knowledge base took this run in."""

    kind: ClassVar[str] = "statistics_updated"


@dataclass(frozen=True, slots=True, kw_only=True)
class Heartbeat(Event):
    """An agent, or the recorder, was alive."""

    kind: ClassVar[str] = "heartbeat"
    agent: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class UnknownEvent(Event):
    """An event of a kind this version does not know; `row` keeps everything it said."""

    row: Mapping[str, Any] = field(default_factory=dict)


EVENT_CLASSES: Final[dict[str, type[Event]]] = {
    cls.kind: cls
    for cls in (
        RunStarted,
        RunEnded,
        TaskDispatched,
        TaskStarted,
        TaskEnded,
        TaskPaused,
        TaskResumed,
        CommandRejected,
        SafetyStateChanged,
        ClockSynced,
        PlanChanged,
        AnnotationAdded,
        StatisticsUpdated,
        Heartbeat,
    )
}
"""Kind to class, the whole vocabulary."""

TASK_KINDS: Final = tuple(kind for kind, cls in EVENT_CLASSES.items() if issubclass(cls, TaskFact))

Fact = TypeVar("Fact", bound=TaskFact)


IDENTITY: Final = (
    "run_id",
    "agent",
    "task",
    "execution_id",
    "task_type",
    "role",
    "attempt",
    "item_id",
    "command_id",
    "parent_execution_id",
)
"""What all events of an execution share, and what its command names it by."""


def identity(execution: object) -> dict[str, Any]:
    """Return the fields of `IDENTITY` by name, of an event of an execution or of its command."""
    return {name: getattr(execution, name) for name in IDENTITY}


def event_on(kind: type[Fact], execution: object, *, time_ns: int, **facts: Any) -> Fact:  # noqa: ANN401 - fields of `kind`
    """Return an execution's next event.

    Args:
        kind: class of the event.
        execution: an event of the execution, or its command.
        time_ns: when it happened, ns on the recorder's clock.
        facts: further fields of that class.
    """
    return kind(time_ns=time_ns, **identity(execution), **facts)
