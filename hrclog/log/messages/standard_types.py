"""Definitions of widely used message types, for bags that store none: those that rosbags does not know."""

from __future__ import annotations

from typing import Final

_SEPARATOR: Final = "=" * 80

STANDARD_TYPES: Final = {
    "plansys2_msgs/msg/ActionExecutionInfo": (
        "int8 status\nbuiltin_interfaces/Time start_stamp\nbuiltin_interfaces/Time status_stamp\n"
        "string action_full_name\nstring action\nstring[] arguments\nbuiltin_interfaces/Duration duration\n"
        "float32 completion\nstring message_status\n"
    ),
    "nav2_msgs/msg/BehaviorTreeLog": (
        "builtin_interfaces/Time timestamp\nnav2_msgs/BehaviorTreeStatusChange[] event_log\n"
        f"{_SEPARATOR}\nMSG: nav2_msgs/BehaviorTreeStatusChange\n"
        "builtin_interfaces/Time timestamp\nstring node_name\nuint16 uid\nstring previous_status\n"
        "string current_status\n"
    ),
    "ur_dashboard_msgs/msg/SafetyMode": "uint8 mode\n",
    "ur_dashboard_msgs/msg/RobotMode": "int8 mode\n",
}
"""Definition by name of the type. Before Jazzy a status change of Nav2 had no `uid`; see `OLDER_TYPES`."""

OLDER_TYPES: Final = {
    "nav2_msgs/msg/BehaviorTreeLog": STANDARD_TYPES["nav2_msgs/msg/BehaviorTreeLog"].replace("uint16 uid\n", ""),
}
"""What a type was before, tried where the definition in `STANDARD_TYPES` does not fit a message."""
