"""Make ros2_actions/: the first runs of the campaign as a ROS 2 bag of two actions, as another cell may record them.

Each agent has one action, whose goals name the task. A topic tells the name of the run, another the robot's speed.
"""

from __future__ import annotations

import sys
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import hrclog

N_RUNS = 6
STATES = {"succeeded": 4, "canceled": 5, "failed": 6}
ACTION = "=" * 80 + "\nACTION: cell_interfaces/action/DoTask\nstring task\n---\nstring message\n---\nfloat32 progress\n"
GOAL = {
    "DoTask_Goal": "string task\n",
    "DoTask_SendGoal_Request": "unique_identifier_msgs/UUID goal_id\ncell_interfaces/DoTask_Goal goal\n",
    "DoTask_SendGoal_Response": "bool accepted\nbuiltin_interfaces/Time stamp\n",
    "DoTask_SendGoal_Event": (
        "service_msgs/ServiceEventInfo info\ncell_interfaces/DoTask_SendGoal_Request[<=1] request\n"
        "cell_interfaces/DoTask_SendGoal_Response[<=1] response\n"
    ),
}
MAPPING = """\
[run]
by = "topic"
topic = "/run_name"
name = { field = "data" }

[[action]]
topic = "/{agent}/do_task"
task = { field = "goal.task" }

[[safety]]
topic = "/robot/speed_scaling"
agent = "robot"
speed = "data"
unit = "percent"
"""
METADATA = """\
rosbag2_bagfile_information:
  version: 9
  storage_identifier: mcap
  relative_file_paths:
    - tuesday_0.mcap
  ros_distro: kilted
"""

Sent = tuple[int, str, str, bytes]
"""(time, topic, type, message)."""


def main(out: Path) -> None:
    """Write the bag and its mapping."""
    folder = out / "ros2_actions"
    (folder / "tuesday").mkdir(parents=True, exist_ok=True)
    (folder / "cell.toml").write_text(MAPPING, encoding="utf-8")
    (folder / "tuesday" / "metadata.yaml").write_text(METADATA, encoding="utf-8")
    runs = sorted((out / "campaign").glob("*.mcap"))[:N_RUNS]
    messages = [message for run in runs for message in _messages(run)]
    _write(folder / "tuesday" / "tuesday_0.mcap", sorted(messages, key=lambda message: message[0]))


def _messages(run: Path) -> Iterator[Sent]:
    events = hrclog.read_events(run).sort("time_ns", "seq").to_dicts()
    begin = min(event["time_ns"] for event in events)
    yield begin, "/run_name", "std_msgs/msg/String", _encoded("std_msgs/msg/String", data=run.stem)
    accepted: dict[str, Any] = {}
    for event in events:
        time_ns, kind = event["time_ns"], event["kind"]
        if kind == "safety_state_changed" and event["agent"] == "robot":
            scale = _encoded("std_msgs/msg/Float64", data=100 * event["speed_scale"])
            yield time_ns, "/robot/speed_scaling", "std_msgs/msg/Float64", scale
        elif kind == "task_started":
            accepted[event["execution_id"]] = time_ns
            yield from _goal(event)
            yield _status(event, time_ns, 1)
            yield _status(event, time_ns, 2)
        elif kind == "task_ended":
            yield _status(event, accepted[event["execution_id"]], STATES[event["outcome"]])
    end = max(event["time_ns"] for event in events)
    yield end + 1, "/run_name", "std_msgs/msg/String", _encoded("std_msgs/msg/String", data="")


def _goal(event: dict[str, Any]) -> Iterator[Sent]:
    """Yield the request of a goal, just before its acceptance."""
    topic, kind = (
        f"/{event['agent']}/do_task/_action/send_goal/_service_event",
        "cell_interfaces/msg/DoTask_SendGoal_Event",
    )
    types = STORE.types
    info = types["service_msgs/msg/ServiceEventInfo"](
        event_type=1, stamp=_time(event["time_ns"]), client_gid=np.zeros(16, np.uint8), sequence_number=event["seq"]
    )
    goal = types["cell_interfaces/msg/DoTask_Goal"](task=event["task"])
    request = types["cell_interfaces/msg/DoTask_SendGoal_Request"](goal_id=_goal_id(event), goal=goal)
    data = _encoded(kind, info=info, request=[request], response=[])
    yield event["time_ns"] - 1_000_000, topic, kind.replace("/msg/", "/action/"), data


def _status(event: dict[str, Any], accepted_ns: int, state: int) -> Sent:
    types = STORE.types
    info = types["action_msgs/msg/GoalInfo"](goal_id=_goal_id(event), stamp=_time(accepted_ns))
    status = types["action_msgs/msg/GoalStatus"](goal_info=info, status=state)
    kind = "action_msgs/msg/GoalStatusArray"
    return event["time_ns"], f"/{event['agent']}/do_task/_action/status", kind, _encoded(kind, status_list=[status])


def _goal_id(event: dict[str, Any]) -> Any:  # noqa: ANN401 - a class that rosbags makes
    raw = np.frombuffer(uuid.UUID(event["execution_id"]).bytes, np.uint8)
    return STORE.types["unique_identifier_msgs/msg/UUID"](uuid=raw)


def _time(time_ns: int) -> Any:  # noqa: ANN401 - a class that rosbags makes
    return STORE.types["builtin_interfaces/msg/Time"](sec=time_ns // 10**9, nanosec=time_ns % 10**9)


def _encoded(kind: str, **fields: Any) -> bytes:  # noqa: ANN401 - of the type's fields
    return bytes(STORE.serialize_cdr(STORE.types[kind](**fields), kind))


def _write(path: Path, messages: list[Sent]) -> None:
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="hrclog sample")
        schemas: dict[str, int] = {}
        channels: dict[str, int] = {}
        for time_ns, topic, kind, data in messages:
            if kind not in schemas:
                text = ACTION if kind.startswith(("cell", "action")) else STORE.generate_msgdef(kind, ros_version=2)[0]
                schemas[kind] = writer.register_schema(kind, "ros2msg", text.encode())
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "cdr", schemas[kind])
            writer.add_message(channels[topic], time_ns, data, time_ns)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it untyped


STORE = get_typestore(Stores.LATEST)
for _name, _text in GOAL.items():
    STORE.register(get_types_from_msg(_text, f"cell_interfaces/msg/{_name}"))

if __name__ == "__main__":
    main(Path(sys.argv[1]))
