"""A short run of a robot arm that pushes a cube, with its cell."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from scenes import ARM_URDF, cell_scene

from hrclog.events import Event, RunEnded, RunStarted, SafetyStateChanged, TaskEnded, TaskStarted
from hrclog.log.messages.encode import DescriptionSignal, FloatSignal, JointSignal, PoseSignal, SceneSignal, Signal
from hrclog.log.writing.writer import write_log

S = 1_000_000_000
T0 = 1_700_000_000 * S
RUN = "run-1"
AGENTS = ("human", "robot")


def write_cell_log(
    path: Path, scene: Mapping[str, Any] | None = None, bodies: Mapping[str, str] | None = None, seconds: int = 6
) -> None:
    """Write a log with joints at 50 Hz, a cube that moves for a second, and areas that are lit."""
    bodies = dict.fromkeys(AGENTS, ARM_URDF) if bodies is None else bodies
    facts = {agent: {"run_id": RUN, "agent": agent, "task": "push", "execution_id": agent} for agent in AGENTS}
    states = ((2, "far", 0.5), (3, "near", 0.0), (4, "", 1.0))
    log: list[Event] = [
        RunStarted(time_ns=T0, run_id=RUN, name="cell", agents=AGENTS),
        *[TaskStarted(time_ns=T0 + S, **facts[agent]) for agent in AGENTS],
        *[
            SafetyStateChanged(time_ns=T0 + at * S, run_id=RUN, agent="robot", zone=zone, speed_scale=scale)
            for at, zone, scale in states
        ],
        *[TaskEnded(time_ns=T0 + 5 * S, **facts[agent]) for agent in AGENTS],
        RunEnded(time_ns=T0 + seconds * S, run_id=RUN),
    ]
    signals: list[Signal] = [SceneSignal(RUN, T0, cell_scene() if scene is None else scene)]
    signals += [DescriptionSignal(RUN, agent, T0, text) for agent, text in bodies.items()]
    for tick in range(seconds * 50):
        time_ns, t = T0 + tick * S // 50, tick / 50
        signals += [JointSignal(RUN, agent, time_ns, ("turn",), (math.sin(t),)) for agent in AGENTS]
        signals.append(FloatSignal(RUN, "min_distance", time_ns, 1 + math.cos(t)))
        if 2 <= t < 3:
            signals.append(PoseSignal(RUN, "cube", time_ns, (0.8, t - 2, 0.55)))
    write_log(path, log, signals)
