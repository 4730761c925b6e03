"""What only a simulator knows: true work, true synergies. A side file that no estimator reads.

Fields that a cell does not know (they have a default) are left out of the file.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hrclog.errors import LogExistsError, ScenarioError
from hrclog.json_text import RESULT_JSON, read_json_file
from hrclog.log.files.system import replace_atomically

if TYPE_CHECKING:
    from hrclog.sim.scenario import Scenario

TRUTH_FILE: Final = "truth.json"
TRUTH_VERSION: Final = 1


@dataclass(frozen=True, slots=True)
class ExecutionTruth:
    """The work that one execution did, in seconds: its duration had nobody else been there.

    Where it is known apart, `planning_s` is the part of the work that was planning, and `lost_s` what others cost:
    its duration is work and loss.
    """

    execution_id: str
    item_id: str
    agent: str
    task: str
    attempt: int
    outcome: str
    work_s: float
    planning_s: float | None = None
    lost_s: float | None = None


@dataclass(frozen=True, slots=True)
class PairTruth:
    """What the tasks of an ordered pair did to each other in a run, in seconds.

    While both went on for `overlap_s`, the first made `progress_s` of its work; it would have made
    `caused_progress_s` had its speed followed without lag what the other asked for.
    """

    agent: str
    task: str
    other_agent: str
    other_task: str
    overlap_s: float
    progress_s: float
    caused_progress_s: float


@dataclass(frozen=True, slots=True)
class RunTruth:
    """The truth about one run; executions in order of their ends; `outcome` is "" for a run that succeeded.

    `pairs` and `contacts` (how often the moving robot touched the human) come from cells where these are counted.
    """

    run_id: str
    name: str
    executions: tuple[ExecutionTruth, ...]
    pairs: tuple[PairTruth, ...] = ()
    contacts: int | None = None
    outcome: str = ""


@dataclass(frozen=True, slots=True)
class TaskTruth:
    """Work of (agent, task): exp(N(mu, sigma^2)) seconds; attempts fail with `failure_probability`.

    None where the truth is what the runs show, and none shows it.
    """

    agent: str
    task: str
    mu: float | None
    sigma: float | None
    failure_probability: float


@dataclass(frozen=True, slots=True)
class SynergyTruth:
    """True factor on human-free work (`synergy_free`); None where the task stops altogether, or is not seen.

    Where the truth is what the runs show, `synergy` is how much slower the task went than it would have alone, `caused`
    how much slower the other task asked it to go, and `overlap_s` how long both went on (see `observed_truth`).
    """

    agent: str
    task: str
    other_agent: str
    other_task: str
    synergy: float | None
    caused: float | None = None
    overlap_s: float | None = None


@dataclass(frozen=True, slots=True)
class Truth:
    """All that is true of a campaign: one row for each (agent, task), and for each ordered pair of different agents.

    `safety` is the policy that guarded the human, where the cell has one.
    """

    scenario: str
    seed: int
    engine: str
    tasks: tuple[TaskTruth, ...]
    synergies: tuple[SynergyTruth, ...]
    runs: tuple[RunTruth, ...]
    safety: str | None = None


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
    replace_atomically(path, lambda stream: stream.write(_truth_text(truth).encode()))


def read_truth(path: Path) -> Truth:
    """Return the truth of a side file.

    Raises:
        ScenarioError: it cannot be read, or is none.
    """
    try:
        value = read_json_file(path, RESULT_JSON)
        return Truth(
            scenario=value["scenario"],
            seed=value["seed"],
            engine=value["engine"],
            tasks=tuple(TaskTruth(**row) for row in value["tasks"]),
            synergies=tuple(SynergyTruth(**row) for row in value["synergies"]),
            runs=tuple(run_from_json(row) for row in value["runs"]),
            safety=value.get("safety"),
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        expected = f"the {TRUTH_FILE} that `hrclog sim` writes beside its logs"
        raise ScenarioError(f"{path}: not a truth file ({error!r}), expected {expected}") from error


def run_to_json(run: RunTruth) -> dict[str, Any]:
    """Return the truth about a run as a JSON value."""
    row = _row(run) | {"executions": [_row(execution) for execution in run.executions]}
    return row | {"pairs": [_row(pair) for pair in run.pairs]} if run.pairs else row


def run_from_json(row: Mapping[str, Any]) -> RunTruth:
    """Return the truth about a run from its JSON value.

    Raises:
        KeyError, TypeError: it is none.
    """
    return RunTruth(
        row["run_id"],
        row["name"],
        tuple(ExecutionTruth(**execution) for execution in row["executions"]),
        tuple(PairTruth(**pair) for pair in row.get("pairs", ())),
        row.get("contacts"),
        row.get("outcome", ""),
    )


def compact_json(value: object) -> str:
    """Return a value as JSON without spaces."""
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"), allow_nan=False)


def _synergy(scenario: Scenario, key: tuple[str, str], other: tuple[str, str]) -> SynergyTruth:
    factor = scenario.factors.get((key, other), 1.0)
    return SynergyTruth(*key, *other, None if math.isinf(factor) else factor)


def _row(part: ExecutionTruth | PairTruth | TaskTruth | SynergyTruth | RunTruth) -> dict[str, Any]:
    """Return the fields of a part by name, without unknown ones."""
    values = ((field, getattr(part, field.name)) for field in fields(part))
    return {field.name: value for field, value in values if value != field.default}


def _truth_text(truth: Truth) -> str:
    head = {
        "schema_version": TRUTH_VERSION,
        "scenario": truth.scenario,
        "seed": truth.seed,
        "engine": truth.engine,
    }
    if truth.safety is not None:
        head["safety"] = truth.safety
    lists = {
        "tasks": [_row(task) for task in truth.tasks],
        "synergies": [_row(synergy) for synergy in truth.synergies],
        "runs": [run_to_json(run) for run in truth.runs],
    }
    parts = [f"{compact_json(name)}:{compact_json(value)}" for name, value in head.items()]
    for name, rows in lists.items():
        lines = ",\n".join(compact_json(row) for row in rows)
        parts.append(f"{compact_json(name)}:[\n{lines}\n]")
    return "{" + ",\n".join(parts) + "}\n"
