"""A score as text for a terminal."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from hrclog.analyzers.synergy.estimators import scored
from hrclog.cli.common import number, table
from hrclog.wording import counted

if TYPE_CHECKING:
    from hrclog.analyzers.prediction.score import Score

_SETTINGS = {
    "cv": "Each run predicted from others (cross-validation by run)",
    "static": "Test runs predicted from training runs, once and for all",
    "prequential": "Test runs predicted in time order from training runs and the test runs before them",
}
_COLUMNS: tuple[tuple[str, Callable[[dict[str, Any]], str]], ...] = (
    ("CRPS s", lambda row: number(row["crps_s"], 3)),
    ("MAE s", lambda row: number(row["mae_s"], 3)),
    ("RMSE s", lambda row: number(row["rmse_s"], 3)),
    ("90 % covers", lambda row: number(row["coverage90"], 3)),
    ("interval score s", lambda row: number(row["interval_score_s"], 2)),
    ("log-lik.", lambda row: number(row["log_likelihood"], 3)),
    ("n", lambda row: str(row["n"])),
)


def score_text(found: Score) -> str:
    """Return the tables of a score."""
    parts = [_headline(found), _overall(found), _per_agent(found), _comparisons(found)]
    if found.truth:
        parts.append(_truth(found))
    return "\n\n".join(part for part in parts if part)


def _headline(score: Score) -> str:
    tested = f"{counted(score.n_test_runs, 'run')}, {counted(score.n_executions, 'execution')}"
    lines = [f"{_SETTINGS[score.setting]}: {tested}, learnt from {counted(score.n_train_runs, 'run')}"]
    if score.setting == "static":
        lines.append(
            "Not calibrated: how far apart sessions are cannot be learnt from one; the intervals promise nothing"
        )
    if score.setting == "cv":
        lines += [
            f"{name} is not calibrated: some task has too few executions to learn from; more runs make it so"
            for name, figures in score.estimators.items()
            if scored(name).conformal and not figures["calibrated"]
        ]
    missing = score.n_executions - max(row["n"] for row in score.estimators.values())
    if missing:
        unknown = counted(missing, "execution is of a task", "executions are of tasks")
        lines.append(f"{unknown} that no run to learn from had finished: not predicted")
    return "\n".join(lines)


def _overall(score: Score) -> str:
    rows = [
        (
            name,
            number(row["crps_s"], 3),
            f"[{number(row['crps_low_s'], 3)}, {number(row['crps_high_s'], 3)}]",
            *(show(row) for _, show in _COLUMNS[1:]),
            number(row["makespan_mae_s"], 2),
            number(row["makespan_bias_s"], 2),
        )
        for name, row in score.estimators.items()
    ]
    header = (
        "estimator",
        "CRPS s",
        "95 % interval",
        *(title for title, _ in _COLUMNS[1:]),
        "makespan MAE s",
        "bias s",
    )
    text = table(header, rows, lambda i: i > 0)
    lowest = [
        f"{name} {number(row['coverage90_worst_five_runs'], 3)}"
        for name, row in score.estimators.items()
        if "coverage90_worst_five_runs" in row
    ]
    return text + (f"\nLowest coverage of five runs in a row: {', '.join(lowest)}" if lowest else "")


def _per_agent(score: Score) -> str:
    rows = [
        (agent, name, *(show(row) for _, show in _COLUMNS))
        for name, figures in score.estimators.items()
        for agent, row in figures["agents"].items()
    ]
    header = ("agent", "estimator", *(title for title, _ in _COLUMNS))
    return table(header, sorted(rows, key=lambda row: row[0]), lambda i: i > 1)


def _comparisons(score: Score) -> str:
    rows = [
        (
            row["other"],
            f"{row['crps_reduction']:.1%}",
            "n/a" if row["low"] is None else f"[{row['low']:.1%}, {row['high']:.1%}]",
        )
        for row in score.comparisons
    ]
    if not rows:
        return ""
    first = score.comparisons[0]["estimator"]
    return f"How much lower the CRPS of {first} is\n" + table(("than", "by", "95 % interval"), rows, lambda i: i > 0)


def _truth(score: Score) -> str:
    rows = [
        (
            name,
            kind.replace("_strong", ", s >= 1.8"),
            *(("n/a" if row[part] is None else f"{row[part]:.1%}") for part in ("bias", "rmse", "coverage95")),
            str(row["n"]),
        )
        for name, figures in score.truth.items()
        for kind, row in figures.items()
        if row["n"]
    ]
    title = "Against the truth (beside: mean duration beside the other's task; free: factor on undisturbed work)"
    return f"{title}\n" + table(("estimator", "what", "bias", "RMSE", "95 % covers", "n"), rows, lambda i: i > 1)
