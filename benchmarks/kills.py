"""SIGKILLs of everything that writes: what was acknowledged, what is lost, what cannot be read."""

from __future__ import annotations

import json
import random
import shutil
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from killed import Left, Server, acknowledged, acknowledged_lines, check_run

from hrclog.knowledge import open_knowledge
from hrclog.log.reader import read_logs

_ENDLESS: Final = 10**6
_N_LINES: Final = 20_000

Situation = Callable[[Server, Path, random.Random], Left]


def _recording(longest_s: float, pace_s: float = 0.0, *, signals: bool = False) -> Situation:
    def kill(server: Server, folder: Path, chance: random.Random) -> Left:
        after_s = chance.uniform(0.0, longest_s)
        server.run_and_kill("record", folder, after_s, pace_s=pace_s, count=_ENDLESS, signals=signals)
        return check_run(folder, acknowledged(folder))

    return kill


def _closing(server: Server, folder: Path, chance: random.Random) -> Left:
    count = chance.randrange(1, 60)
    server.run_and_kill("record", folder, chance.uniform(0.0, 0.1), pace_s=0.0, count=count)
    return check_run(folder, acknowledged(folder))


def _recovering(server: Server, folder: Path, chance: random.Random) -> Left:
    server.run_and_kill("record", folder, 0.05, pace_s=0.0, count=_ENDLESS)
    server.run_and_kill("close", folder, chance.uniform(0.0, 0.02))
    return check_run(folder, acknowledged(folder))


def _resuming(server: Server, folder: Path, chance: random.Random) -> Left:
    server.run_and_kill("record", folder, 0.03, pace_s=0.0, count=_ENDLESS)
    server.run_and_kill("record", folder, chance.uniform(0.0, 0.1), pace_s=0.0, count=_ENDLESS, resume=True)
    return check_run(folder, acknowledged(folder))


def _piping(server: Server, folder: Path, chance: random.Random) -> Left:
    lines = [{"kind": "run_started", "name": "piped"}]
    for i in range(_N_LINES):
        kind = ("task_started", "task_ended")[i % 2]
        lines.append({"kind": kind, "agent": "robot", "task": f"task {i // 2 % 7}"})
    (folder / "lines.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    server.run_and_kill("pipe", folder, chance.uniform(0.0, 0.3))
    return check_run(folder, acknowledged_lines(folder))


def _simulating(server: Server, folder: Path, chance: random.Random) -> Left:
    """Check that each run that is there is whole: a log appears when all of it is written."""
    server.run_and_kill("simulate", folder, chance.uniform(0.0, 1.5), seed=chance.randrange(1000))
    paths = sorted((folder / "sim").glob("*.mcap*"))
    left = Left("runs" if paths else "nothing", len(paths))
    for path in paths:
        logs = read_logs(path)
        whole = logs.events["kind"].to_list()[-1:] == ["run_ended"]
        left.expect(not any(finding.severity == "error" for finding in logs.diagnostics), f"{path.name} has errors")
        left.n_lost += not whole
    return left


def _learning(server: Server, folder: Path, chance: random.Random) -> Left:
    server.run_and_kill("learn", folder, chance.uniform(0.1, 0.8), step=chance.choice((5, 20)))
    ready = acknowledged(folder)
    expected = int(ready[-1][1]) if ready else 0
    # it may be killed before there is anything
    with open_knowledge(str(folder / "kb.sqlite"), create=True) as kb, kb.view() as view:
        runs, results, made = view.runs(), view.results(), view.statistics()
    left = Left("runs" if runs else "nothing", expected, max(expected - len(runs), 0))
    executions = {run.run_id: run.n_executions for run in runs}
    left.expect(Counter(results["run_id"].to_list()) == executions, "a run is there in part")
    left.expect(made is None or len(made.runs) <= len(runs), "statistics are of runs that are not there")
    return left


SITUATIONS: Final[Mapping[str, Situation]] = {
    "recorder, full pace": _recording(0.3),
    "recorder, human pace": _recording(0.6, 0.05),
    "recorder, with signals": _recording(0.3, signals=True),
    "recorder, during close": _closing,
    "`recover`": _recovering,
    "resume": _resuming,
    "`hrclog record`": _piping,
    "`hrclog sim`": _simulating,
    "knowledge base": _learning,
}


def kill_many(n_kills: int, seed: int, folder: Path, on_kill: Callable[[], None]) -> list[dict[str, Any]]:
    """Return a row per situation: kills, acknowledged, lost, faults."""
    rows: dict[str, dict[str, Any]] = {
        name: {
            "situation": name,
            "kills": 0,
            "acknowledged": 0,
            "lost": 0,
            "faulty": 0,
            "states": Counter(),
            "faults": [],
        }
        for name in SITUATIONS
    }
    with Server() as server:
        for number in range(n_kills):
            name = list(SITUATIONS)[number % len(SITUATIONS)]
            place = folder / str(number)
            place.mkdir(parents=True)
            left = _left_by(SITUATIONS[name], server, place, random.Random(f"{seed}:{number}"))  # noqa: S311 - no secret
            row = rows[name]
            row["kills"] += 1
            row["acknowledged"] += left.n_acknowledged
            row["lost"] += left.n_lost
            row["faulty"] += bool(left.faults)
            row["states"][left.state] += 1
            row["faults"] += left.faults
            if not left.faults and not left.n_lost:
                shutil.rmtree(place)
            on_kill()
    return list(rows.values())


def _left_by(situation: Situation, server: Server, folder: Path, chance: random.Random) -> Left:
    try:
        return situation(server, folder, chance)
    except Exception as error:  # noqa: BLE001 - whatever it is, what was left cannot be read
        return Left("unreadable", faults=[f"unreadable: {type(error).__name__}: {error}"])
