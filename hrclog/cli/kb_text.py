"""The output of `hrclog kb show`."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from hrclog.cli.common import number, table
from hrclog.wording import counted

if TYPE_CHECKING:
    from hrclog.knowledge.properties import TaskProperties
    from hrclog.knowledge.task_times import TaskTime
    from hrclog.knowledge.view import StatisticsEntry, View


def contents(view: View) -> dict[str, Any]:
    """Return everything but single executions as JSON values."""
    return {
        "runs": [asdict(run) for run in view.runs()],
        "statistics": made_from(view.statistics()),
        "missing_runs": missing(view),
        "durations": view.durations().to_dicts(),
        "synergies": view.synergies().to_dicts(),
        "times": view.times().to_json(),
        "properties": [asdict(task) for task in view.properties()],
    }


def made_from(made: StatisticsEntry | None) -> dict[str, Any] | None:
    """Return what statistics are made from as JSON values; the runs by their ids."""
    return asdict(made) | {"runs": [run for run, _ in made.runs]} if made else None


def missing(view: View) -> int:
    """Return how many runs the statistics lack, hold in another version, or hold although they were withdrawn since."""
    statistics = view.statistics()
    differing = set(view.used_runs()) ^ set(statistics.runs if statistics else ())
    return len({run for run, _ in differing})


def contents_text(view: View) -> str:
    """Return the tables of everything but single executions."""
    parts = [_runs(view), _source(view)]
    parts += [_durations(view), _synergies(view), _guesses(view.properties())]
    return "\n\n".join(part for part in parts if part)


def _runs(view: View) -> str:
    rows = [
        (
            run.name or run.run_id,
            run.outcome or "not ended",
            str(run.n_executions),
            "" if run.withdrawn is None else f"withdrawn: {run.withdrawn or 'no reason given'}",
        )
        for run in view.runs()
    ]
    return table(("run", "outcome", "executions", ""), rows, lambda i: i == 2) if rows else "no runs"


def _source(view: View) -> str:
    statistics, n_missing = view.statistics(), missing(view)
    if statistics is None:
        return "no statistics yet: hrclog kb update makes them" if n_missing else "no statistics"
    estimator = f"{statistics.estimator} {statistics.estimator_version}"
    text = f"statistics of {counted(len(statistics.runs), 'run')}, estimator {estimator}"
    text += "" if statistics.outliers == "none" else f", outliers left out by {statistics.outliers}"
    return f"{text}; behind by {n_missing}: hrclog kb update follows" if n_missing else text


def _durations(view: View) -> str:
    times = view.times().times
    rows = []
    for row in view.durations().iter_rows(named=True):
        time = times.get((row["agent"], row["task"]))
        figures = (row["mean_s"], row["std_s"], row["median_s"])
        count, failed = str(row["count"]), str(row["n_failed"])
        rows.append((f"{row['agent']} {row['task']}", count, failed, *map(number, figures), _alone(time)))
    return table(("agent task", "n", "failed", "mean s", "std s", "median s", "alone s"), rows) if rows else ""


def _alone(time: TaskTime | None) -> str:
    """Return the expected work with its standard error."""
    if time is None:
        return "n/a"
    deviation = time.mean_deviation_s
    return number(time.mean_s) + ("" if deviation is None else f" +- {number(deviation)}")


def _synergies(view: View) -> str:
    observed = [row for row in view.synergies().iter_rows(named=True) if row["status"] != "unobserved"]
    rows = [
        (
            f"{row['agent']} {row['task']}",
            f"{row['other_agent']} {row['other_task']}",
            number(row["synergy"]),
            number(row["std_err"]),
            f"{number(row['ci_low'])} .. {number(row['ci_high'])}" if row["ci_low"] is not None else "n/a",
            str(row["n"]),
            row["status"],
        )
        for row in observed
    ]
    header = ("agent task", "beside", "synergy", "error", "95 %", "n", "status")
    return table(header, rows, lambda i: i in (2, 3, 4, 5)) if rows else ""


def _guesses(tasks: list[TaskProperties]) -> str:
    rows = [(f"{agent} {task.task}", number(guess)) for task in tasks for agent, guess in task.expected_s.items()]
    return table(("agent task", "guess s"), sorted(rows)) if rows else ""
