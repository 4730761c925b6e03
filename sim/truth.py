"""What only a simulator knows: true work, true synergies. A side file that no estimator reads."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hrclog.errors import LogExistsError, ScenarioError
from hrclog.log.files import replace_atomically

if TYPE_CHECKING:
    from hrclog.sim.scenario import Scenario

TRUTH_FILE: Final = "truth.json"
SCHEMA_VERSION: Final = 1


@dataclass(frozen=True, slots=True)
class ExecutionTruth:
    """The work that one execution did, in seconds: its duration had nobody else been there."""

    execution_id: str
    item_id: str
    agent: str
    task: str
    attempt: int
    outcome: str
    work_s: float


@dataclass(frozen=True, slots=True)
class RunTruth:
    """The truth about one run; executions in order of their ends."""

    run_id: str
    name: str
    executions: tuple[ExecutionTruth, ...]


@dataclass(frozen=True, slots=True)
class TaskTruth:
    """Work of (agent, task): exp(N(mu, sigma^2)) seconds; attempts fail with `failure_probability`."""

    agent: str
    task: str
    mu: float
    sigma: float
    failure_probability: float


@dataclass(frozen=True, slots=True)
class SynergyTruth:
    """True factor on human-free work (`synergy_free`); None where the task stops altogether."""

    agent: str
    task: str
    other_agent: str
    other_task: str
    synergy: float | None


@dataclass(frozen=True, slots=True)
class Truth:
    """All that is true of a campaign: one row for each (agent, task), and for each ordered pair of different agents."""

    scenario: str
    seed: int
    engine: str
    tasks: tuple[TaskTruth, ...]
    synergies: tuple[SynergyTruth, ...]
    runs: tuple[RunTruth, ...]


def scenario_truth(scenario: Scenario, seed: int, runs: Iterable[RunTruth] = ()) -> Truth:
    """Return the truth of a campaign of the discrete-event cell."""
    keys = scenario.problem.agent_tasks()
    works = [scenario.work[key] for key in keys]
    return Truth(
        scenario.name,
        seed,
        "events",
        tuple(TaskTruth(w.agent, w.task, w.time.mu, w.time.sigma, w.failure_probability) for w in works),
        tuple(_synergy(scenario, key, other) for key in keys for other in keys if key[0] != other[0]),
        tuple(runs),
    )


def write_truth(path: Path, truth: Truth) -> None:
    """Write the side file as JSON, one run a line, as a whole or not at all.

    Raises:
        LogExistsError: the file exists.
        LogWriteError: it cannot be written.
    """
    if path.exists():
        raise LogExistsError(path, "choose another folder")
    replace_atomically(path, lambda stream: stream.write(_text(truth).encode()))


def read_truth(path: Path) -> Truth:
    """Return the truth of a side file.

    Raises:
        ScenarioError: it cannot be read, or is none.
    """
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
        return Truth(
            scenario=value["scenario"],
            seed=value["seed"],
            engine=value["engine"],
            tasks=tuple(TaskTruth(**row) for row in value["tasks"]),
            synergies=tuple(SynergyTruth(**row) for row in value["synergies"]),
            runs=tuple(_run(row) for row in value["runs"]),
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        expected = f"the {TRUTH_FILE} that `hrclog sim` writes beside its logs"
        raise ScenarioError(f"{path}: not a truth file ({error!r}), expected {expected}") from error


def _synergy(scenario: Scenario, key: tuple[str, str], other: tuple[str, str]) -> SynergyTruth:
    factor = scenario.factors.get((key, other), 1.0)
    return SynergyTruth(*key, *other, None if math.isinf(factor) else factor)


def _run(row: dict[str, Any]) -> RunTruth:
    executions = tuple(ExecutionTruth(**execution) for execution in row["executions"])
    return RunTruth(row["run_id"], row["name"], executions)


def _text(truth: Truth) -> str:
    head = {
        "schema_version": SCHEMA_VERSION,
        "scenario": truth.scenario,
        "seed": truth.seed,
        "engine": truth.engine,
    }
    lists: dict[str, tuple[TaskTruth | SynergyTruth | RunTruth, ...]] = {
        "tasks": truth.tasks,
        "synergies": truth.synergies,
        "runs": truth.runs,
    }
    parts = [f"{_json(name)}:{_json(value)}" for name, value in head.items()]
    for name, rows in lists.items():
        lines = ",\n".join(_json(asdict(row)) for row in rows)
        parts.append(f"{_json(name)}:[\n{lines}\n]")
    return "{" + ",\n".join(parts) + "}\n"


def _json(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
