"""Write a first mapping for the topics of a recording: what can be told from names and types, to be corrected."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Final

from hrclog.recorders.mapping import ros2_goals
from hrclog.recorders.mapping.actions import ROS1_TYPES, Action
from hrclog.recorders.mapping.behavior_tree import BehaviorTree
from hrclog.recorders.mapping.meaning import Meaning
from hrclog.recorders.mapping.plansys2 import PlanSys2
from hrclog.recorders.mapping.safety import KNOWN_MODES, Safety
from hrclog.recorders.mapping.signals import Joints, Signal
from hrclog.wording import counted

Topic = tuple[str, str]
"""(topic, type)."""

_BY_TYPE: Final[dict[str, type[Meaning]]] = {
    "plansys2_msgs/msg/ActionExecutionInfo": PlanSys2,
    "nav2_msgs/msg/BehaviorTreeLog": BehaviorTree,
    "sensor_msgs/msg/JointState": Joints,
    "std_msgs/msg/Float64": Signal,
    "std_msgs/msg/Float32": Signal,
    **dict.fromkeys(KNOWN_MODES, Safety),
}
_MODE_FIELDS: Final = {"franka_msgs/msg/FrankaRobotState": "robot_mode"}
_SPEED_TOPICS: Final = {"speed_scaling": "percent", "speed_scaling_factor": "fraction"}
_GOAL: Final = re.compile(r"^(?:ACTION: \S+|MSG: \S+(?<!Action)Goal)\n(.*?)(?=^---|^===|\Z)", re.DOTALL | re.MULTILINE)
_TEXT: Final = re.compile(r"^[^\S\n]*string(?:<=\d+)?[^\S\n]+(\w+)[^\S\n]*(?:#.*)?$", re.MULTILINE)
_TASK_FIELDS: Final = ("task", "task_name", "name", "skill", "operation", "command")
_HEAD: Final = "# A first mapping: check agents and tasks. docs/bags.md describes every key."
_UNNAMED: Final = (
    '\n# task = { field = "goal.task" }  # in the place of the line above, if a field of the goal names the task'
)
_UNDEFINED: Final = (
    "\n# The goals are recorded, but not the definition of their type. As it stands, all goals are one task."
    "\n# To name the task by a field of the goal, put these two lines, with the goal of your .action file, in the place"
    "\n# of the line above:"
    '\n# definition = "string task"'
    '\n# task = { field = "goal.task" }'
)
_TASKS: Final = (Action.kind, PlanSys2.kind, BehaviorTree.kind)
_NO_TASK: Final = (
    "# No topic of a known kind. Name the fields of a message that tells the state of a task:\n"
    '# [[task]]\n# topic = "/task_state"\n# agent = "robot"\n# task = { field = "task" }\n'
    '# state = { field = "state" }\n'
    '# started = ["RUNNING"]\n# succeeded = ["DONE"]\n# failed = ["ERROR"]'
)


def suggestion(topics: Mapping[Topic, int], definitions: Mapping[Topic, str]) -> str:
    """Return a first mapping as TOML; comments list the topics.

    Args:
        topics: how many messages there are of each.
        definitions: of their types, as far as they are known.
    """
    lines = [_HEAD, "#", f"# {counted(len(topics), 'topic')}:"]
    for (topic, kind), count in sorted(topics.items()):
        lines.append(f"#   {_quoted(topic)[1:-1]}  {_quoted(kind)[1:-1] or 'no type'}  {counted(count, 'message')}")
    tables = [*_actions(topics, definitions), *(table for key in sorted(topics) for table in _table(*key))]
    families = [kind for kind in _TASKS if any(table.startswith(f"[[{kind}]]") for table in tables)]
    if not families:
        tables.append(_NO_TASK)
    others = tuple(f"[[{kind}]]" for kind in families[1:])
    tables = [_commented(table) if table.startswith(others) else table for table in tables]
    return "\n".join([*lines, *(f"\n{table}" for table in tables)])


def _commented(table: str) -> str:
    """Return a table that is not read: what it tells is told by another table already."""
    lines = "\n".join(f"# {line}" for line in table.splitlines())
    return f"# These tell the same tasks, probably; take one of them only.\n{lines}"


def _actions(topics: Mapping[Topic, int], definitions: Mapping[Topic, str]) -> Iterator[str]:
    goals: dict[str, str] = {}
    for topic, kind in sorted(topics):
        suffixes = {suffix: part for suffix, part in ros2_goals.SUFFIXES.items() if topic.endswith(suffix)}
        suffixes |= {
            f"/{part}": part for part, end in ROS1_TYPES.items() if topic.endswith(f"/{part}") and kind.endswith(end)
        }
        for suffix, part in suffixes.items():
            name = topic.removesuffix(suffix)
            goals.setdefault(name, "")
            if part in ("send_goal", "goal"):
                goals[name] = definitions.get((topic, kind), "") or "?"
    for name, definition in goals.items():
        if not name.strip("/"):
            continue
        agent, task = _agent_and_task(name)
        field = _task_field(definition)
        named = f'{{ field = "goal.{field}" }}' if field else _quoted(task)
        hint = "" if field or not definition else _UNDEFINED if definition == "?" else _UNNAMED
        yield f"[[action]]\ntopic = {_quoted(name)}\nagent = {_quoted(agent)}\ntask = {named}{hint}"


def _task_field(definition: str) -> str:
    """Return the text of a goal that probably names the task, "" if there is none."""
    goal = _GOAL.search(definition)
    texts = _TEXT.findall(goal[1]) if goal else []
    return next((name for name in texts if name in _TASK_FIELDS), texts[0] if len(texts) == 1 else "")


def _table(topic: str, kind: str) -> Iterator[str]:
    """Yield the table of a topic that is told by its type."""
    meaning = _BY_TYPE.get(kind) if topic.strip("/") else None
    last = topic.rstrip("/").rsplit("/", 1)[-1]
    head = "" if meaning is None else f"[[{meaning.kind}]]\ntopic = {_quoted(topic)}\n"
    agent = _quoted(_agent_and_task(topic)[0])
    if meaning is Signal and last in _SPEED_TOPICS:
        unit = _SPEED_TOPICS[last]
        yield f'[[{Safety.kind}]]\ntopic = {_quoted(topic)}\nagent = "robot"\nspeed = "data"\nunit = "{unit}"'
    elif meaning is Safety:
        yield f'{head}agent = "robot"\nmode = "{_MODE_FIELDS.get(kind, "mode")}"'
    elif meaning is Signal:
        yield f'{head}name = {_quoted(last)}\nfield = "data"'
    elif meaning is PlanSys2:
        yield f'{head}agent = {{ field = "arguments[0]" }}\ntask = {{ field = "action" }}'
    elif meaning is BehaviorTree:
        yield f'{head}agent = "robot"\nnodes = ["*"]  # the nodes that are tasks'
    elif meaning is not None:
        yield f"{head}agent = {agent if topic.count('/') > 1 else _quoted('robot')}"


def _agent_and_task(name: str) -> tuple[str, str]:
    parts = [part for part in name.split("/") if part]
    return (parts[0] if len(parts) > 1 else "robot"), (parts[-1] if parts else "task")


def _quoted(text: str) -> str:
    """Return a text as TOML writes it, with nothing that a terminal or a comment would take amiss."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{"".join(_escaped(character) for character in escaped)}"'


def _escaped(character: str) -> str:
    code = ord(character)
    return (
        character
        if character.isprintable() or character == " "
        else f"\\U{code:08x}"
        if code > 0xFFFF
        else f"\\u{code:04x}"
    )
