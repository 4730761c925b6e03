"""Regenerate the tables of docs/estimators.md: what every estimator and every variant that was tried does.

python benchmarks/estimators.py [--data DIR] [--repeats 20] [--write]

DIR holds safety_areas/; without it the tables of the authors' runs stay as they are.
"""

from __future__ import annotations

import argparse
import json
import re
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl
from measure import cpu_seconds, peak_mebibytes

from hrclog.analyzers.prediction.conformal import conformal
from hrclog.analyzers.prediction.plan_cells import plan_cells
from hrclog.analyzers.prediction.residuals import Learning
from hrclog.analyzers.prediction.score import score
from hrclog.analyzers.prediction.score_truth import pair_errors, true_pairs, truth_figures
from hrclog.analyzers.prediction.settings import (
    SCORED,
    Predictions,
    cross_validate,
    predict_prequential,
    predict_static,
)
from hrclog.analyzers.projections.intervals import intervals
from hrclog.analyzers.synergy.aft import aft
from hrclog.analyzers.synergy.aft_likelihood import Prior
from hrclog.analyzers.synergy.estimators import ESTIMATORS
from hrclog.analyzers.synergy.observations import observe
from hrclog.event_rows import to_row
from hrclog.log.messages.decode import frame_of_rows
from hrclog.log.reader import read_events
from hrclog.recorders.importers.mongo import import_mongo
from hrclog.sim.run import simulate_run
from hrclog.sim.scenario import Scenario, load_scenario
from hrclog.sim.truth import scenario_truth

ROOT = Path(__file__).parents[1]
_BLUE = "blue_box"
PAGE = ROOT / "docs" / "estimators.md"
SEED = 7
SIZES = (10, 50, 500)
TAUS = (0.5, 0.75, 1.0)
LEARNING = {
    "each task follows the session": (Learning(width_step=0.0), "none"),
    "and each place of an agent's order": (Learning(width_step=0.0), "position"),
    "and each place of a plan": (Learning(width_step=0.0), "plan"),
    "the same, cells as wide as tasks": (Learning(width_step=0.0, cell_share=1.0), "plan"),
    "each task, width adapts": (Learning(), "none"),
    "each place of a plan, width adapts (used)": (Learning(), "plan"),
    "the same, width adapts faster": (Learning(width_step=0.05), "plan"),
    "the same, forgets faster": (Learning(kept=0.9), "plan"),
    "the same, forgets nothing": (Learning(kept=1.0), "plan"),
}


def main() -> None:
    """Compute all tables, print them, and write them into the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--repeats", type=int, default=20)
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    tables = dict(_tables(arguments.data, arguments.repeats))
    for name, text in tables.items():
        print(f"\n{name}\n\n{text}")
    if arguments.write:
        page = PAGE.read_text(encoding="utf-8")
        for name, text in tables.items():
            page = _replaced(page, name, text)
        PAGE.write_text(page, encoding="utf-8")


def _tables(data: Path | None, repeats: int) -> Iterator[tuple[str, str]]:
    scenario = load_scenario("paper")
    runs = _simulated(scenario, max(SIZES) * repeats)
    yield (
        "truth",
        _truth_table(scenario, runs, repeats, {name: ESTIMATORS[name].fit for name in ESTIMATORS} | _yardstick()),
    )
    yield "priors", _priors_table(scenario, runs, repeats)
    yield "size", _size_table(runs)
    yield "misspecified", _misspecified_table(scenario, repeats)
    if data:
        with tempfile.TemporaryDirectory() as folder:
            offline = _authors(data / "safety_areas" / "task_results.json", Path(folder) / "offline")
            online = _authors(data / "safety_areas" / "task_results_online.json", Path(folder) / "online")
        yield "published", _published_table(data / "safety_areas" / "task_synergies.json", offline)
        scored = {
            "within the offline session (cv, 5 folds)": cross_validate(offline),
            "offline to online, static": predict_static(offline, online),
            "offline to online, prequential": predict_prequential(offline, online),
        }
        yield "settings", _settings_table(scored)
        yield "session", _session_table(offline, online)
        yield "widths", _widths_table(offline)


def _yardstick() -> dict[str, Any]:
    return {"mean": SCORED["mean"]}


def _simulated(scenario: Scenario, count: int) -> pl.DataFrame:
    """Return the intervals of runs 0, 1, ...; column `index` numbers them."""
    parts = []
    for low in range(0, count, 500):
        simulated = [simulate_run(scenario, SEED, index) for index in range(low, min(low + 500, count))]
        rows = [{"log_time_ns": 0} | to_row(event) for run in simulated for event in run.events]
        number = pl.DataFrame(
            {"run_id": [run.truth.run_id for run in simulated], "index": range(low, low + len(simulated))}
        )
        events = frame_of_rows(rows).with_columns(pl.lit("simulated").alias("path"))
        parts.append(intervals(events).join(number, on="run_id"))
    return pl.concat(parts)


def _samples(runs: pl.DataFrame, size: int, repeats: int) -> Iterator[pl.DataFrame]:
    for repeat in range(repeats):
        yield runs.filter(pl.col("index") // size == repeat)


def _truth_of(scenario: Scenario) -> pl.DataFrame:
    truth = scenario_truth(scenario, SEED)
    return true_pairs(
        [(row.agent, row.task, row.mu, row.sigma) for row in truth.tasks],
        [(row.agent, row.task, row.other_agent, row.other_task, row.synergy) for row in truth.synergies],
    )


def _truth_table(scenario: Scenario, runs: pl.DataFrame, repeats: int, estimators: dict[str, Any]) -> str:
    truth = _truth_of(scenario)
    lines = [
        (
            "| runs | estimator | exp(mu) s where s >= 1.8: bias | RMSE | all pairs: bias | RMSE | 95 % covers "
            "| synergy_free: bias | RMSE | 95 % covers |"
        ),
        "| --- " * 10 + "|",
    ]
    for size in SIZES:
        samples = [observe(part) for part in _samples(runs, size, repeats)]
        for name, estimator in estimators.items():
            errors = pl.concat([pair_errors(estimator(sample, "none"), sample, truth) for sample in samples])
            found = truth_figures(errors)
            cells = [
                _percent(found["beside_strong"]["bias"]),
                _percent(found["beside_strong"]["rmse"]),
                *(_percent(found["beside"][part]) for part in ("bias", "rmse", "coverage95")),
                *(_percent(found["free"][part]) for part in ("bias", "rmse", "coverage95")),
            ]
            lines.append(f"| {size} | `{name}` | {' | '.join(cells)} |")
    return "\n".join(lines)


def _priors_table(scenario: Scenario, runs: pl.DataFrame, repeats: int) -> str:
    truth = _truth_of(scenario)
    lines = [
        "| runs | prior of log s | where s >= 1.8: bias | RMSE | 95 % covers | all pairs: RMSE | 95 % covers |",
        "| --- " * 7 + "|",
    ]
    for size in SIZES[:2]:
        samples = [observe(part) for part in _samples(runs, size, repeats)]
        for tau in TAUS:
            prior = Prior(tau=tau)
            found = truth_figures(pl.concat([pair_errors(aft(s, "none", prior), s, truth) for s in samples]))
            strong, all_pairs = found["beside_strong"], found["beside"]
            cells = [_percent(strong[part]) for part in ("bias", "rmse", "coverage95")]
            cells += [_percent(all_pairs[part]) for part in ("rmse", "coverage95")]
            lines.append(f"| {size} | N(0, {tau}²){' (used)' if tau == Prior().tau else ''} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _size_table(runs: pl.DataFrame) -> str:
    lines = ["| runs | executions | observing, CPU s | `aft`, CPU s | peak MiB |", "| --- " * 5 + "|"]
    for size in (*SIZES, runs["run_id"].n_unique()):
        part = runs.filter(pl.col("index") < size)
        observations = observe(part)
        watch = cpu_seconds(lambda part=part: observe(part), 1)  # type: ignore[misc]  # a lambda's default has no type
        fit = cpu_seconds(lambda seen=observations: aft(seen), 1)  # type: ignore[misc]  # a lambda's default has no type
        lines.append(f"| {size:,} | {part.height:,} | {watch:.2f} | {fit:.2f} | {peak_mebibytes():.0f} |")
    return "\n".join(lines)


def _published_table(path: Path, offline: pl.DataFrame) -> str:
    published = pl.DataFrame(
        [
            {
                "agent": row["agent"],
                "task": row["agent_skill"],
                "other_agent": row["concurrent_agent"],
                "other_task": row["concurrent_skill"],
                "published": float(row["dynamic_risk"]),
                "published_error": float(row["std_err"]),
                "counter": int(row["counter"]),
            }
            for row in json.loads(path.read_text(encoding="utf-8"))
        ]
    )
    observations = observe(offline)
    lines = ["| estimator | largest difference of s | mean | largest ratio of standard errors | counters equal |"]
    lines.append("| --- " * 5 + "|")
    for name in ("bayes", "ols"):
        table = ESTIMATORS[name].fit(observations, "none").synergies
        both = published.join(table, on=["agent", "task", "other_agent", "other_task"])
        apart = (both["synergy"] - both["published"]).abs()
        ratio = both["std_err"] / both["published_error"]
        largest = max(ratio.max(), 1 / ratio.min())  # type: ignore[operator,type-var]  # a float column
        same = int((both["n"] == both["counter"]).sum())
        lines.append(f"| `{name}` | {apart.max():.3f} | {apart.mean():.3f} | {largest:.2f} | {same} of {both.height} |")
    return "\n".join(lines)


def _settings_table(scored: dict[str, Predictions]) -> str:
    lines = [
        (
            "| setting | estimator | CRPS s | MAE s | RMSE s | 90 % covers | interval score s | log-likelihood "
            "| makespan MAE s | bias s | CRPS of `aft` lower by, 95 % interval |"
        ),
        "| --- " * 11 + "|",
    ]
    for setting, predictions in scored.items():
        found = score(predictions)
        lower = {row["other"]: row for row in found.comparisons}
        for name, row in found.estimators.items():
            reduction = lower.get(name)
            than = (
                f"{reduction['crps_reduction']:.1%} [{reduction['low']:.1%}, {reduction['high']:.1%}]"
                if reduction
                else ""
            )
            lines.append(
                f"| {setting} | `{name}` | {row['crps_s']:.3f} | {row['mae_s']:.3f} | {row['rmse_s']:.3f} "
                f"| {row['coverage90']:.3f} | {row['interval_score_s']:.2f} | {row['log_likelihood']:.3f} "
                f"| {row['makespan_mae_s']:.2f} | {row['makespan_bias_s']:.2f} | {than} |"
            )
    return "\n".join(lines)


def _session_table(offline: pl.DataFrame, online: pl.DataFrame) -> str:
    cells: dict[str, Callable[[pl.DataFrame], pl.DataFrame]] = {
        "none": lambda frame: plan_cells(frame).with_columns(pl.col("execution_id").alias("cell")),
        "position": lambda frame: plan_cells(frame).with_columns(pl.col("position").cast(pl.String).alias("cell")),
        "plan": plan_cells,
    }
    lines = [
        "| what is learnt from run to run | CRPS s | 90 % covers | worst five runs | log-likelihood |",
        "| --- " * 5 + "|",
    ]
    for name, (learning, kind) in LEARNING.items():
        predictions = predict_prequential(offline, online, ["aft"], learning=learning, cells_of=cells[kind])
        row = score(predictions).estimators["aft"]
        lines.append(
            f"| {name} | {row['crps_s']:.3f} | {row['coverage90']:.3f} "
            f"| {row['coverage90_worst_five_runs']:.3f} | {row['log_likelihood']:.3f} |"
        )
    return "\n".join(lines)


def _widths_table(offline: pl.DataFrame) -> str:
    """Compare the fitted normal with conformal residuals, by folds of runs."""
    from hrclog.analyzers.prediction.folds import folds
    from hrclog.analyzers.prediction.held_out import FORECASTS, HeldOut

    observations, held_out = observe(offline), HeldOut(offline)
    rows: dict[str, list[tuple[Any, ...]]] = {"fitted normal": [], "conformal residuals (used)": []}
    for part in folds(observations.runs, 5, 0):
        train = observations.without(part)
        fit = aft(train)
        for name, models in zip(rows, (fit.models, conformal(ESTIMATORS["aft"], fit, train).models), strict=True):
            for run in part:
                rows[name] += held_out.forecasts(name, run, lambda key, _, models=models: models.get(key))  # type: ignore[misc]  # a lambda's default has no type
    lines = ["| width of `aft` | CRPS s | 90 % covers | log-likelihood |", "| --- " * 4 + "|"]
    for name, found in rows.items():
        frame = pl.DataFrame(found, schema=FORECASTS, orient="row")
        covered = frame["observed_s"].is_between(frame["low_s"], frame["high_s"]).mean()
        lines.append(f"| {name} | {frame['crps_s'].mean():.3f} | {covered:.3f} | {frame['log_density'].mean():.3f} |")
    return "\n".join(lines)


def _misspecified_table(scenario: Scenario, repeats: int) -> str:
    """Let only the placing of the human's blue boxes slow the robot, and show picking and placing as one task."""
    partly = _only_placing_disturbs(scenario)
    runs = _joined(_simulated(partly, 50 * repeats))
    fits = [aft(observe(part)) for part in _samples(runs, 50, repeats)]
    lines = [
        "| robot task | true s while placing (a third of it) | else | `aft`: mean of synergy_free | least | most |",
        "| --- " * 6 + "|",
    ]
    for task in ("pick_blue_box", "place_blue_box", "pick_orange_box", "place_orange_box"):
        row = (pl.col("agent") == "robot") & (pl.col("task") == task) & (pl.col("other_task") == _BLUE)
        found = [value for fit in fits if (value := fit.synergies.filter(row)["synergy_free"].item()) is not None]
        true = partly.factors[("robot", task), ("human", "place_blue_box")]
        lines.append(f"| {task} | {true:g} | 1 | {sum(found) / len(found):.2f} | {min(found):.2f} | {max(found):.2f} |")
    scored = score(cross_validate(next(_samples(runs, 50, 1))))
    figures = ", ".join(
        f"`{name}` {row['crps_s']:.3f} ({row['coverage90']:.3f})" for name, row in scored.estimators.items()
    )
    return "\n".join(lines) + f"\n\nCRPS in s (coverage of 90 %), 5 folds of 50 such runs: {figures}."


def _only_placing_disturbs(scenario: Scenario) -> Scenario:
    synergies = tuple(
        replace(one, factor=1.0) if (one.other_agent, one.other_task) == ("human", "pick_blue_box") else one
        for one in scenario.synergies
    )
    return replace(scenario, synergies=synergies)


def _joined(runs: pl.DataFrame) -> pl.DataFrame:
    """Make one execution of each of the human's blue picks and the placing that follows it."""
    human = runs.filter(pl.col("agent") == "human").sort("run_id", "start_ns")
    following = {name: pl.col(name).shift(-1).over("run_id") for name in ("end_ns", "until_ns")}
    blue = human.with_columns(**following).filter(pl.col("task") == "pick_blue_box")
    rest = runs.filter((pl.col("agent") != "human") | ~pl.col("task").str.contains("blue"))
    return pl.concat([rest, blue.with_columns(pl.lit(_BLUE).alias("task"))])


def _authors(path: Path, folder: Path) -> pl.DataFrame:
    import_mongo([path], folder)
    return intervals(read_events([folder]))


def _percent(value: float | None) -> str:
    return "n/a" if value is None else f"{value:.1%}"


def _replaced(page: str, name: str, text: str) -> str:
    """Put a table between its marks."""
    begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
    pattern = re.compile(re.escape(begin) + ".*?" + re.escape(end), re.DOTALL)
    if not pattern.search(page):
        raise SystemExit(f"{PAGE}: no marks {begin} ... {end}")
    return pattern.sub(lambda _: f"{begin}\n{text}\n{end}", page)


if __name__ == "__main__":
    main()
