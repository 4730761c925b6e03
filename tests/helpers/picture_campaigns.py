"""Small campaigns that are hard to draw."""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from pathlib import Path

from hrclog import Recorder

S = 1_000_000_000
BEGAN = 1_790_000_000 * S
WORDS = (
    *("把持", "配置", "Schraube", "überprüfen", "затянуть", "ロボット", "التقاط", "pick", "place"),
    *("naïve", "façade", "Kettenglied", "assemblé", "σφίξε", "a/b", "<b>", "$x_1$", "\\", "“so”"),
)
UNICODE = ("操作员 (human operator)", "robot_αβγ_with_a_long_name_on_a_rail")


def apart(folder: Path, runs: int = 3) -> None:
    """Write runs in which two agents take turns."""
    tasks = {"human": ["pick", "place"], "robot": ["weld", "turn"]}
    _write(folder, runs, tasks, at_once=False)


def many_tasks(folder: Path, agents: Sequence[str], runs: int = 3) -> None:
    """Write runs in which each agent does sixty tasks with long names."""
    source = random.Random(1)
    names = {agent: [f"{' '.join(source.choices(WORDS, k=6))}_{at:02}" for at in range(60)] for agent in agents}
    _write(folder, runs, names, at_once=True)


def _write(folder: Path, runs: int, tasks: Mapping[str, Sequence[str]], *, at_once: bool) -> None:
    folder.mkdir()
    source = random.Random(2)
    for number in range(runs):
        _write_run(folder / f"run_{number}.mcap", BEGAN + number * 10_000 * S, tasks, source, at_once=at_once)


def _write_run(
    path: Path, began: int, tasks: Mapping[str, Sequence[str]], source: random.Random, *, at_once: bool
) -> None:
    """Write a run in which each agent does all of its tasks in some order."""
    spans: list[tuple[int, int, str, str]] = []
    free = began + S
    for agent, own in tasks.items():
        at = began + S if at_once else free
        for task in source.sample(list(own), len(own)):
            start = at + round(source.uniform(0.1, 1) * S)
            at = start + round(source.lognormvariate(1.5, 0.3) * S)
            spans.append((start, at, agent, task))
        free = max(free, at)
    now = began
    with Recorder(path, run=path.stem, agents=list(tasks), time_ns=began, clock_ns=lambda: now) as recorder:
        handles = {}
        changes = [(start, 1, span) for span, (start, *_) in enumerate(spans)]
        changes += [(end, 0, span) for span, (_, end, *_) in enumerate(spans)]
        for now, begins, span in sorted(changes):
            _, _, agent, task = spans[span]
            if begins:
                handles[span] = recorder.start(agent, task, time_ns=now)
            else:
                recorder.end(handles[span], "succeeded", time_ns=now)
