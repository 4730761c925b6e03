"""Two sets of runs (planners, days, safety settings) and how they differ."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Final

import polars as pl

from hrclog._version import __version__
from hrclog.analyzers.comparison import schemas
from hrclog.analyzers.comparison.draws import draw_runs
from hrclog.analyzers.comparison.means import compare_means
from hrclog.analyzers.comparison.synergies import compare_synergies, draw_synergies, side_synergies
from hrclog.analyzers.comparison.totals import duration_totals, metric_totals, plan_totals, success_totals
from hrclog.analyzers.projections.overlaps import PAIR
from hrclog.analyzers.result import Analysis
from hrclog.diagnostic import Diagnostic
from hrclog.errors import HrclogError
from hrclog.wording import counted

COMPARISON_VERSION: Final = 1
DEFAULT_DRAWS: Final = 200
TABLES: Final = ("metrics", "durations", "success_rates", "plan", "synergies")


@dataclass(frozen=True, slots=True)
class Side:
    """One of the two sets of runs: ids of its runs that have executions, and its agents, both sorted."""

    run_ids: tuple[str, ...]
    agents: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Comparison:
    """How B differs from A; the frames' columns are in `hrclog.analyzers.comparison.schemas`.

    Attributes:
        notes: what limits the comparison, in sentences.
    """

    a: Side
    b: Side
    metrics: pl.DataFrame
    durations: pl.DataFrame
    success_rates: pl.DataFrame
    plan: pl.DataFrame
    synergies: pl.DataFrame
    notes: tuple[str, ...]
    diagnostics: list[Diagnostic]
    estimator: str
    outliers: str
    bootstrap: int
    seed: int

    @property
    def compared(self) -> int:
        """Return how many rows have an interval."""
        return sum(getattr(self, name)["differs"].count() for name in TABLES)

    @property
    def differing(self) -> int:
        """Return how many of the intervals exclude that there is no difference."""
        return sum(int(getattr(self, name)["differs"].sum()) for name in TABLES)

    def to_dict(self) -> dict[str, Any]:
        """Return the machine-readable result: durations in seconds, null where not known."""
        return {
            "schema_version": COMPARISON_VERSION,
            "hrclog_version": __version__,
            "estimator": self.estimator,
            "outliers": self.outliers,
            "bootstrap": self.bootstrap,
            "seed": self.seed,
            "a": {"run_ids": list(self.a.run_ids), "agents": list(self.a.agents)},
            "b": {"run_ids": list(self.b.run_ids), "agents": list(self.b.agents)},
            **{name: getattr(self, name).to_dicts() for name in TABLES},
            "compared": self.compared,
            "differing": self.differing,
            "notes": list(self.notes),
            "diagnostics": [diagnostic.as_dict() for diagnostic in self.diagnostics],
        }

    def to_json(self) -> str:
        """Return `to_dict` as JSON text."""
        return json.dumps(self.to_dict(), ensure_ascii=False, indent=2, allow_nan=False)


def compare(
    a: Analysis,
    b: Analysis,
    *,
    bootstrap: int = DEFAULT_DRAWS,
    seed: int = 0,
    workers: int = 1,
    on_draws: Callable[[int], None] = lambda _: None,
) -> Comparison:
    """Compare two sets of runs: metrics, durations, success rates, plan against reality, and synergies.

    Intervals come from whole runs drawn with repetition, each side on its own.

    Args:
        a: the runs that are compared with.
        b: the runs that are compared, analysed by the same estimator.
        bootstrap: how many draws; 0 leaves the intervals out.
        seed: of the draws; the result depends on it, not on the workers or the order of the files.
        workers: processes for the synergies of the draws.
        on_draws: told how many further draws of the synergies of a side are done, for progress.

    Raises:
        HrclogError: a side has no executions, a run is on both sides, the sides were analysed differently, or there is
            a single draw.
    """
    if bootstrap < 0 or bootstrap == 1:
        raise HrclogError(f"the number of bootstrap draws is {bootstrap}, expected at least 2, or 0 for no intervals")
    _check_analysed(a, b)
    if (a.estimator, a.outliers) != (b.estimator, b.outliers):
        methods = " and ".join(f"{side.estimator} with outliers {side.outliers}" for side in (a, b))
        raise HrclogError(f"the sides were analysed by {methods}, expected the same for both; analyse them alike")
    _check_apart(a, b)
    first, second = _side(a, "A"), _side(b, "B")
    draws_a, draws_b = (draw_runs(side.run_ids, bootstrap, seed) for side in (first, second))

    def means(totals: Callable[[pl.DataFrame], pl.DataFrame], schema: pl.Schema) -> pl.DataFrame:
        return compare_means(totals(a.intervals), totals(b.intervals), draws_a, draws_b, schema)

    pairs_a, pairs_b = (side_synergies(side.synergies, side.observations, a.estimator) for side in (a, b))
    drawn: list[pl.DataFrame | None] = [None, None]
    if bootstrap and all(len(side.observations.runs) > 1 for side in (a, b)) and _have_common_pair(pairs_a, pairs_b):
        drawn = [
            draw_synergies(side.observations, a.estimator, a.outliers, bootstrap, seed, workers, on_draws)
            for side in (a, b)
        ]
    return Comparison(
        a=first,
        b=second,
        metrics=compare_means(metric_totals(a.metrics), metric_totals(b.metrics), draws_a, draws_b, schemas.METRICS),
        durations=means(duration_totals, schemas.DURATIONS),
        success_rates=means(success_totals, schemas.SUCCESS_RATES),
        plan=means(plan_totals, schemas.PLAN),
        synergies=compare_synergies(pairs_a, pairs_b, drawn[0], drawn[1], bootstrap),
        notes=tuple(_notes(a, b, first, second, bootstrap)),
        diagnostics=[*_side_diagnostics(a, "A"), *_side_diagnostics(b, "B")],
        estimator=a.estimator,
        outliers=a.outliers,
        bootstrap=bootstrap,
        seed=seed,
    )


def _check_analysed(*sides: object) -> None:
    for side in sides:
        if not isinstance(side, Analysis):
            raise HrclogError(
                f"compare: found {side!r}, expected what `analyze` returns: compare(analyze(A), analyze(B))"
            )


def _side(analysis: Analysis, name: str) -> Side:
    runs, agents = (analysis.intervals[column].unique().sort().to_list() for column in ("run_id", "agent"))
    if not runs:
        contents = f"{counted(analysis.runs.height, 'run')} without an execution" if analysis.runs.height else "no runs"
        raise HrclogError(f"side {name}: found {contents}, expected at least one with executions; name other logs")
    return Side(tuple(runs), tuple(agents))


def _check_apart(a: Analysis, b: Analysis) -> None:
    shared = (
        a.runs.select("run_id", "name", "path")
        .join(b.runs.select("run_id", pl.col("path").alias("other")), on="run_id")
        .sort("run_id")
    )
    if shared.is_empty():
        return
    run = shared.row(0, named=True)
    more = f", and {counted(shared.height - 1, 'more is', 'more are')}" if shared.height > 1 else ""
    raise HrclogError(
        f"run {run['name']!r} ({run['run_id']}) is on both sides, in {run['path']} and {run['other']}{more}; expected "
        "each run on one side, as intervals take the sides for independent; leave it out of one"
    )


def _have_common_pair(a: pl.DataFrame, b: pl.DataFrame) -> bool:
    known = pl.col("synergy").is_not_null()
    return a.filter(known).join(b.filter(known), on=PAIR, how="semi").height > 0


def _side_diagnostics(analysis: Analysis, name: str) -> list[Diagnostic]:
    """Return the findings of a side; those that name no file name the side."""
    return [
        diagnostic if diagnostic.path else replace(diagnostic, message=f"{name}: {diagnostic.message}")
        for diagnostic in analysis.diagnostics
    ]


def _notes(a: Analysis, b: Analysis, first: Side, second: Side, bootstrap: int) -> Iterator[str]:
    counts = [f"{name} has {len(side.run_ids)}" for name, side in (("A", first), ("B", second))]
    if not bootstrap:
        yield "No runs were drawn (bootstrap 0), so there are no intervals."
    elif min(len(first.run_ids), len(second.run_ids)) < 2:
        yield f"There are no intervals: they need at least 2 runs on each side; {', '.join(counts)}."
    tasks = [set(side.intervals.select("agent", "task").unique().rows()) for side in (a, b)]
    agents = f"A has the agents {', '.join(first.agents)}; B has {', '.join(second.agents)}"
    if not tasks[0] & tasks[1]:
        yield f"No task of an agent is on both sides, so only what is of whole runs is compared: {agents}."
    elif first.agents != second.agents:
        yield f"The sides have different agents: {agents}."
