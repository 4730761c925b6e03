"""The result of an analysis: all frames of a set of runs, and the ways to show them."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import polars as pl

from hrclog._version import __version__
from hrclog.analyzers.projections.metrics import nested
from hrclog.analyzers.projections.tags import run_record
from hrclog.analyzers.synergy.fit import Fit
from hrclog.analyzers.synergy.observations import Observations
from hrclog.analyzers.synergy.outlier_methods import Outliers
from hrclog.diagnostic import Diagnostic
from hrclog.log.annotations.exclusions import Exclusion
from hrclog.log.messages.recorded_scene import RecordedScene

if TYPE_CHECKING:
    from hrclog.analyzers.figures import CampaignFigures, RunFigures

ANALYSIS_VERSION: Final = 1


@dataclass(frozen=True, repr=False)  # without slots, which leave no place for what is computed when it is asked for
class Analysis:
    """The result for a set of runs. `hrclog.analyzers.projections.schemas` has the frames' columns."""

    events: pl.DataFrame
    signals: pl.DataFrame
    intervals: pl.DataFrame
    overlaps: pl.DataFrame
    pair_overlaps: pl.DataFrame
    durations: pl.DataFrame
    synergies: pl.DataFrame
    runs: pl.DataFrame
    metrics: pl.DataFrame
    diagnostics: list[Diagnostic]
    estimator: str
    outliers: Outliers
    bootstrap: int  # draws of runs that errors and intervals of synergies come from; 0 if they are the estimator's
    observations: Observations
    fit: Fit
    scene: RecordedScene = field(default_factory=RecordedScene)
    exclusions: list[Exclusion] = field(default_factory=list)

    @cached_property
    def executions(self) -> pl.DataFrame:
        """Return the long table for statistics: one row per execution, with its run, tags and seconds beside others.

        Its columns are those of `EXECUTIONS`, one per tag, and one per agent.
        """
        from hrclog.analyzers.projections.executions import executions
        from hrclog.log.runs.tags import run_tags

        return executions(self.intervals, self.runs, run_tags(self.events))

    def __repr__(self) -> str:
        from hrclog.analyzers.notebook import headline

        return f"<hrclog.Analysis: {headline(self.runs, self.diagnostics)}>"

    def _repr_html_(self) -> str:
        """Return what a notebook shows: a summary and the heatmap of the synergies."""
        from hrclog.analyzers.notebook import page

        return page(self.runs, self.durations, self.synergies, self.diagnostics)

    def to_dict(self) -> dict[str, Any]:
        """Return the machine-readable result: instants `*_ns`, durations `*_s`, null where not known."""
        from hrclog.log.runs.tags import run_tags

        metrics_by_run, tags = nested(self.metrics), run_tags(self.events)
        return {
            "schema_version": ANALYSIS_VERSION,
            "hrclog_version": __version__,
            "estimator": self.estimator,
            "outliers": self.outliers,
            "bootstrap": self.bootstrap,
            "runs": [
                run_record(row, tags) | {"metrics": metrics_by_run.get(row["run_id"], {})}
                for row in self.runs.iter_rows(named=True)
            ],
            "durations": self.durations.to_dicts(),
            "synergies": self.synergies.to_dicts(),
            "overlaps": self.pair_overlaps.to_dicts(),
            "exclusions": [exclusion.as_dict() for exclusion in self.exclusions],
            "diagnostics": [diagnostic.as_dict() for diagnostic in self.diagnostics],
        }

    def to_json(self) -> str:
        """Return `to_dict` as JSON text."""
        return json.dumps(self.to_dict(), ensure_ascii=False, indent=2, allow_nan=False)

    def campaign_figures(self) -> CampaignFigures:
        """Return everything drawable of all runs together."""
        from hrclog.analyzers.figures import Further, campaign_figures
        from hrclog.analyzers.projections.plan_labels import plan_labels
        from hrclog.analyzers.synergy.settling import settle, settle_durations

        final = None if self.bootstrap else self.synergies  # drawn intervals are of another kind than those before
        settling = settle(
            self.intervals, self.runs, self.estimator, self.outliers, observations=self.observations, final=final
        )
        further = Further(self.metrics, plan_labels(self.events), settling, settle_durations(self.intervals, self.runs))
        return campaign_figures(
            self.intervals, self.pair_overlaps, self.durations, self.synergies, self.runs, self.diagnostics, further
        )

    def run_figures(self, run_id: str) -> RunFigures:
        """Return everything drawable of one run."""
        from hrclog.analyzers.figures import run_figures

        run = self.runs.row(by_predicate=pl.col("run_id") == run_id, named=True)
        frames = (self.intervals, self.events, self.signals)
        intervals, events, signals = (frame.filter(pl.col("run_id") == run_id) for frame in frames)
        tasks = self.durations["task"].to_list()
        return run_figures(run, intervals, events, signals, self.scene.of_run(run_id), tasks)

    def to_rerun(self, path: str | Path) -> None:
        """Write the campaign's recording: matrices, synergies, durations, tables, laid out."""
        from hrclog.analyzers.rerun.save import save_campaign

        save_campaign(self.campaign_figures(), Path(path))

    def run_to_rerun(self, run_id: str, path: str | Path) -> None:
        """Write one run's recording: its cell, timeline, safety, signals and events, laid out."""
        from hrclog.analyzers.rerun.save import save_run

        save_run(self.run_figures(run_id), Path(path))

    def to_report(self, path: str | Path, *, runs: int = 4, title: str = "") -> None:
        """Write one self-contained HTML file that shows and explains everything.

        Args:
            path: of the file.
            runs: how many single runs it shows.
            title: its heading, "" for one that counts the runs.
        """
        from hrclog.analyzers.report.save import save_report

        save_report(self, Path(path), runs=runs, title=title)
