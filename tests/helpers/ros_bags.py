"""Write bags as recorders of ROS leave them: MCAP and SQLite parts of ROS 2, and bags of ROS 1."""

# ruff: noqa: ANN401 - messages are of classes that rosbags makes
from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

SEPARATOR = "=" * 80 + "\n"
ACTION_TEXT = (
    f"{SEPARATOR}ACTION: cell/action/DoTask\nstring task\n---\nbool ok\nstring message\n---\nfloat32 progress\n"
)
STATUS = "action_msgs/msg/GoalStatusArray"
SEND_GOAL = "cell/action/DoTask_SendGoal_Event"
GET_RESULT = "cell/action/DoTask_GetResult_Event"
FEEDBACK = "cell/action/DoTask_FeedbackMessage"
PLANSYS2 = "plansys2_msgs/msg/ActionExecutionInfo"
NAV2 = "nav2_msgs/msg/BehaviorTreeLog"
TASK_STATE = "cell/msg/TaskState"

DEFINITIONS = {
    PLANSYS2: (
        "int8 NOT_EXECUTED=1\nint8 status\nbuiltin_interfaces/Time start_stamp\nbuiltin_interfaces/Time status_stamp\n"
        "string action_full_name\nstring action\nstring[] arguments\nbuiltin_interfaces/Duration duration\n"
        "float32 completion\nstring message_status\n"
    ),
    NAV2: (
        "builtin_interfaces/Time timestamp\nnav2_msgs/BehaviorTreeStatusChange[] event_log\n"
        f"{SEPARATOR}MSG: nav2_msgs/BehaviorTreeStatusChange\nbuiltin_interfaces/Time timestamp\nstring node_name\n"
        "uint16 uid\nstring previous_status\nstring current_status\n"
    ),
    TASK_STATE: (
        "std_msgs/Header header\nstring device\nstring agent\nstring job\nstring id\nint32 state\nstring text\n"
        "float64[] distances\nfloat64 epoch_s\n"
    ),
}
_EVENT = (
    "service_msgs/ServiceEventInfo info\ncell/DoTask_{0}_Request[<=1] request\ncell/DoTask_{0}_Response[<=1] response\n"
)
_ACTION_PARTS = {
    "DoTask_Goal": "string task\n",
    "DoTask_Result": "bool ok\nstring message\n",
    "DoTask_Feedback": "float32 progress\n",
    "DoTask_SendGoal_Request": "unique_identifier_msgs/UUID goal_id\ncell/DoTask_Goal goal\n",
    "DoTask_SendGoal_Response": "bool accepted\nbuiltin_interfaces/Time stamp\n",
    "DoTask_GetResult_Request": "unique_identifier_msgs/UUID goal_id\n",
    "DoTask_GetResult_Response": "int8 status\ncell/DoTask_Result result\n",
    "DoTask_FeedbackMessage": "unique_identifier_msgs/UUID goal_id\ncell/DoTask_Feedback feedback\n",
    "DoTask_SendGoal_Event": _EVENT.format("SendGoal"),
    "DoTask_GetResult_Event": _EVENT.format("GetResult"),
}
_ROS1_PARTS = {
    "cell/msg/DoTaskGoal": "string task\n",
    "cell/msg/DoTaskResult": "string message\n",
    "cell/msg/DoTaskActionGoal": "std_msgs/Header header\nactionlib_msgs/GoalID goal_id\ncell/DoTaskGoal goal\n",
    "cell/msg/DoTaskActionResult": (
        "std_msgs/Header header\nactionlib_msgs/GoalStatus status\ncell/DoTaskResult result\n"
    ),
}


def _ros2_store() -> Typestore:
    store = get_typestore(Stores.LATEST)
    for name, text in DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    store.register(
        {
            name: kind
            for part, text in _ACTION_PARTS.items()
            for name, kind in get_types_from_msg(text, f"cell/msg/{part}").items()
        }
    )
    return store


def _ros1_store() -> Typestore:
    store = get_typestore(Stores.ROS1_NOETIC)
    for name, text in _ROS1_PARTS.items():
        store.register(get_types_from_msg(text, name))
    return store


ROS2 = _ros2_store()
ROS1 = _ros1_store()


@dataclass(frozen=True)
class Sent:
    """A message as a recorder gets it: when, where, of which type, encoded."""

    time_ns: int
    topic: str
    kind: str
    data: bytes


def made(store: Typestore, kind: str, **fields: Any) -> Any:
    """Return a message of a type."""
    return store.types[kind](**fields)


def ros2(time_ns: int, topic: str, kind: str, **fields: Any) -> Sent:
    """Return a message of ROS 2; action types are written by their name within `cell/msg`."""
    name = kind.replace("/action/", "/msg/")
    return Sent(time_ns, topic, kind, bytes(ROS2.serialize_cdr(made(ROS2, name, **fields), name)))


def ros1(time_ns: int, topic: str, kind: str, **fields: Any) -> Sent:
    """Return a message of ROS 1."""
    return Sent(time_ns, topic, kind, bytes(ROS1.serialize_ros1(made(ROS1, kind, **fields), kind)))


def stamp(time_ns: int, store: Typestore = ROS2) -> Any:
    return made(store, "builtin_interfaces/msg/Time", sec=time_ns // 10**9, nanosec=time_ns % 10**9)


def header(time_ns: int) -> Any:
    return made(ROS2, "std_msgs/msg/Header", stamp=stamp(time_ns), frame_id="")


def goal_uuid(name: str) -> Any:
    raw = np.frombuffer(hashlib.md5(name.encode(), usedforsecurity=False).digest(), np.uint8)
    return made(ROS2, "unique_identifier_msgs/msg/UUID", uuid=raw)


def status_array(time_ns: int, action: str, states: Sequence[tuple[str, int, int]]) -> Sent:
    """Return the status of goals: (name of the goal, acceptance, state)."""
    entries = [
        made(
            ROS2,
            "action_msgs/msg/GoalStatus",
            goal_info=made(ROS2, "action_msgs/msg/GoalInfo", goal_id=goal_uuid(name), stamp=stamp(accepted)),
            status=state,
        )
        for name, accepted, state in states
    ]
    return ros2(time_ns, f"{action}/_action/status", STATUS, status_list=entries)


def _info(kind: int, time_ns: int, number: int) -> Any:
    gid = np.arange(16, dtype=np.uint8)
    return made(
        ROS2,
        "service_msgs/msg/ServiceEventInfo",
        event_type=kind,
        stamp=stamp(time_ns),
        client_gid=gid,
        sequence_number=number,
    )


def send_goal(time_ns: int, action: str, goal: str, task: str, number: int, *, accepted: bool = True) -> list[Sent]:
    """Return the request and the response of a goal, as the server tells them."""
    topic = f"{action}/_action/send_goal/_service_event"
    request = made(
        ROS2,
        "cell/msg/DoTask_SendGoal_Request",
        goal_id=goal_uuid(goal),
        goal=made(ROS2, "cell/msg/DoTask_Goal", task=task),
    )
    response = made(ROS2, "cell/msg/DoTask_SendGoal_Response", accepted=accepted, stamp=stamp(0))
    return [
        ros2(time_ns, topic, SEND_GOAL, info=_info(1, time_ns, number), request=[request], response=[]),
        ros2(time_ns, topic, SEND_GOAL, info=_info(2, time_ns, number), request=[], response=[response]),
    ]


def get_result(time_ns: int, action: str, goal: str, state: int, message: str, number: int) -> list[Sent]:
    """Return the request and the response of a result, as the server tells them."""
    topic = f"{action}/_action/get_result/_service_event"
    request = made(ROS2, "cell/msg/DoTask_GetResult_Request", goal_id=goal_uuid(goal))
    result = made(ROS2, "cell/msg/DoTask_Result", ok=state == 4, message=message)
    response = made(ROS2, "cell/msg/DoTask_GetResult_Response", status=state, result=result)
    return [
        ros2(time_ns, topic, GET_RESULT, info=_info(1, time_ns, number), request=[request], response=[]),
        ros2(time_ns, topic, GET_RESULT, info=_info(2, time_ns, number), request=[], response=[response]),
    ]


def feedback(time_ns: int, action: str, goal: str, progress: float) -> Sent:
    inner = made(ROS2, "cell/msg/DoTask_Feedback", progress=progress)
    return ros2(time_ns, f"{action}/_action/feedback", FEEDBACK, goal_id=goal_uuid(goal), feedback=inner)


def text(time_ns: int, topic: str, value: str) -> Sent:
    return ros2(time_ns, topic, "std_msgs/msg/String", data=value)


def number(time_ns: int, topic: str, value: float) -> Sent:
    return ros2(time_ns, topic, "std_msgs/msg/Float64", data=value)


def plansys2(time_ns: int, full_name: str, status: int, start: int, changed: int, seconds: int = 4) -> Sent:
    """Return one report of PlanSys2; the full name is `(action argument ...):milliseconds`."""
    action, *arguments = full_name[1:].partition(")")[0].split()
    duration = made(ROS2, "builtin_interfaces/msg/Duration", sec=seconds, nanosec=0)
    return ros2(
        time_ns, "/action_execution_info", PLANSYS2, status=status,
        start_stamp=stamp(start), status_stamp=stamp(changed),
        action_full_name=full_name, action=action, arguments=arguments, duration=duration, completion=0.0,
        message_status="",
    )  # fmt: skip


def tree_log(time_ns: int, changes: Iterable[tuple[int, str, str, str]]) -> Sent:
    """Return changes of nodes: (time, node, state before, state)."""
    entries = [
        made(ROS2, "nav2_msgs/msg/BehaviorTreeStatusChange", timestamp=stamp(at), node_name=node, uid=len(node),
             previous_status=before, current_status=after)
        for at, node, before, after in changes
    ]  # fmt: skip
    return ros2(time_ns, "/behavior_tree_log", NAV2, timestamp=stamp(0), event_log=entries)


def definition_of(kind: str, style: str) -> tuple[str, str]:
    """Return (encoding, text) of a type's definition as a recorder of that time stores it."""
    if style == "none":
        return "", ""
    if "/action/" in kind:
        return ("unknown", "") if style == "jazzy" else ("ros2msg", ACTION_TEXT)
    if kind == STATUS and style == "kilted":
        return "ros2msg", ACTION_TEXT
    if kind in DEFINITIONS:
        return "ros2msg", DEFINITIONS[kind]
    return "ros2msg", ROS2.generate_msgdef(kind, ros_version=2)[0]


def write_bag(folder: Path, messages: Sequence[Sent], storage: str = "mcap", style: str = "kilted") -> Path:
    """Write a ROS 2 bag: a folder with one part and `metadata.yaml`."""
    name = f"{folder.name}_0.{'mcap' if storage == 'mcap' else 'db3'}"
    (write_mcap if storage == "mcap" else write_sqlite)(folder / name, messages, style)
    listed = f"rosbag2_bagfile_information:\n  version: 9\n  relative_file_paths:\n    - {name}\n"
    (folder / "metadata.yaml").write_text(listed)
    return folder


def write_mcap(path: Path, messages: Sequence[Sent], style: str = "kilted", chunk_size: int = 1 << 16) -> Path:
    """Write a part of a ROS 2 bag as MCAP."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as stream:
        writer = McapWriter(stream, chunk_size=chunk_size, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="tests")
        channels: dict[str, int] = {}
        schemas: dict[str, int] = {}
        for message in sorted(messages, key=lambda sent: sent.time_ns):
            if message.kind not in schemas:
                encoding, content = definition_of(message.kind, style)
                schemas[message.kind] = writer.register_schema(message.kind, encoding, content.encode())
            if message.topic not in channels:
                channels[message.topic] = writer.register_channel(message.topic, "cdr", schemas[message.kind])
            writer.add_message(channels[message.topic], message.time_ns, message.data, message.time_ns)
        writer.finish()
    return path


def write_sqlite(path: Path, messages: Sequence[Sent], style: str = "none") -> Path:
    """Write a part of a ROS 2 bag as SQLite; `none` is how it was before there were definitions in it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    database = sqlite3.connect(path)
    with database:
        database.execute(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT, "
            "offered_qos_profiles TEXT)"
        )
        database.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
        )
        kinds = dict.fromkeys((sent.topic, sent.kind) for sent in messages)
        ids = {topic: number for number, (topic, _) in enumerate(kinds, 1)}
        database.executemany(
            "INSERT INTO topics VALUES (?, ?, ?, 'cdr', '')", [(ids[topic], topic, kind) for topic, kind in kinds]
        )
        if style != "none":
            database.execute(
                "CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT, encoding TEXT, "
                "encoded_message_definition TEXT, type_description_hash TEXT)"
            )
            rows = [(kind, *definition_of(kind, style)) for kind in dict.fromkeys(kind for _, kind in kinds)]
            database.executemany("INSERT INTO message_definitions VALUES (NULL, ?, ?, ?, '')", rows)
        ordered = sorted(messages, key=lambda sent: sent.time_ns)
        database.executemany(
            "INSERT INTO messages VALUES (NULL, ?, ?, ?)",
            [(ids[sent.topic], sent.time_ns, sent.data) for sent in ordered],
        )
    database.close()
    return path


def write_ros1(path: Path, messages: Sequence[Sent]) -> Path:
    """Write a ROS 1 bag."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with Ros1Writer(path) as writer:
        writer.chunk_threshold = 2000
        connections: dict[str, Any] = {}
        for message in sorted(messages, key=lambda sent: sent.time_ns):
            if message.topic not in connections:
                connections[message.topic] = writer.add_connection(message.topic, message.kind, typestore=ROS1)
            writer.write(connections[message.topic], message.time_ns, message.data)
    return path


def _ros1_status(goal: str, state: int, reason: str = "") -> Any:
    goal_id = made(ROS1, "actionlib_msgs/msg/GoalID", stamp=stamp(0, ROS1), id=goal)
    return made(ROS1, "actionlib_msgs/msg/GoalStatus", goal_id=goal_id, status=state, text=reason)


def _ros1_header(time_ns: int) -> Any:
    return made(ROS1, "std_msgs/msg/Header", seq=0, stamp=stamp(time_ns, ROS1), frame_id="")


def ros1_goal(log_ns: int, time_ns: int, action: str, goal: str, task: str) -> Sent:
    goal_id = made(ROS1, "actionlib_msgs/msg/GoalID", stamp=stamp(time_ns, ROS1), id=goal)
    inner = made(ROS1, "cell/msg/DoTaskGoal", task=task)
    kind = "cell/msg/DoTaskActionGoal"
    return ros1(log_ns, f"{action}/goal", kind, header=_ros1_header(time_ns), goal_id=goal_id, goal=inner)


def ros1_status(log_ns: int, time_ns: int, action: str, states: Sequence[tuple[str, int]]) -> Sent:
    entries = [_ros1_status(goal, state) for goal, state in states]
    kind = "actionlib_msgs/msg/GoalStatusArray"
    return ros1(log_ns, f"{action}/status", kind, header=_ros1_header(time_ns), status_list=entries)


def ros1_result(log_ns: int, time_ns: int, action: str, goal: str, state: int, reason: str = "") -> Sent:
    kind = "cell/msg/DoTaskActionResult"
    inner = made(ROS1, "cell/msg/DoTaskResult", message="")
    status = _ros1_status(goal, state, reason)
    return ros1(log_ns, f"{action}/result", kind, header=_ros1_header(time_ns), status=status, result=inner)
