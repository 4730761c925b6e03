"""Everything drawable of many runs together."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import polars as pl

from hrclog.analyzers.figures.boxplot import duration_boxes
from hrclog.analyzers.figures.boxplot_plot import boxplot_plot
from hrclog.analyzers.figures.coefficients import synergy_coefficients
from hrclog.analyzers.figures.coefficients_plot import coefficients_plot
from hrclog.analyzers.figures.fluency import fluency_plots
from hrclog.analyzers.figures.heatmap import Heatmap
from hrclog.analyzers.figures.heatmap_plot import heatmap_plot
from hrclog.analyzers.figures.makespans import makespan_plot
from hrclog.analyzers.figures.overlap_matrix import overlap_matrices
from hrclog.analyzers.figures.plot import Page
from hrclog.analyzers.figures.settling import duration_curves, settling_curves, settling_heatmaps
from hrclog.analyzers.figures.synergy_heatmap import synergy_heatmaps
from hrclog.analyzers.figures.table import DataTable
from hrclog.analyzers.projections.schemas import METRICS, PLAN_LABELS, SETTLING, SETTLING_DURATIONS
from hrclog.diagnostic import Diagnostic
from hrclog.wording import counted

MAX_AGENT_PAIRS: Final = 12

_KEY: Final = ("agent", "task", "count")
_COUNTS: Final = ("n_failed", "n_canceled", "n_censored", "success_rate", "success_low", "success_high")
_TIMES: Final = (*_KEY, "mean_s", "std_s", "median_s", "q25_s", "q75_s", "min_s", "max_s", *_COUNTS)
_FITS: Final = (
    *_KEY,
    *("lognormal_mu", "lognormal_sigma", "lognormal_aic"),
    *("gamma_shape", "gamma_scale_s", "gamma_aic"),
)


@dataclass(frozen=True, slots=True, eq=False)
class Matrix:
    """The values of a heatmap on a page, under the same path."""

    path: tuple[str, ...]
    heatmap: Heatmap


@dataclass(frozen=True, slots=True, eq=False)
class Further:
    """Further frames that a campaign may show. Each field is named after its schema."""

    metrics: pl.DataFrame = field(default_factory=METRICS.to_frame)
    plan_labels: pl.DataFrame = field(default_factory=PLAN_LABELS.to_frame)
    settling: pl.DataFrame = field(default_factory=SETTLING.to_frame)
    settling_durations: pl.DataFrame = field(default_factory=SETTLING_DURATIONS.to_frame)
    settling_note: str = ""  # of the settling synergies


@dataclass(frozen=True, slots=True, eq=False)
class CampaignFigures:
    """The pictures of a campaign: pages to look at, matrices and tables to read back."""

    campaign_id: str
    name: str
    pages: tuple[Page, ...]
    matrices: tuple[Matrix, ...]
    tables: tuple[DataTable, ...]
    facts: tuple[tuple[str, str | int | float], ...] = ()
    captions: tuple[str, ...] = ()


def campaign_figures(
    intervals: pl.DataFrame,
    pair_overlaps: pl.DataFrame,
    durations: pl.DataFrame,
    synergies: pl.DataFrame,
    runs: pl.DataFrame,
    diagnostics: Sequence[Diagnostic],
    further: Further | None = None,
) -> CampaignFigures:
    """Return the figures of a campaign.

    Args:
        intervals: schema `INTERVALS`, as are the others of the schema of their name.
        pair_overlaps: `PAIR_OVERLAPS`.
        durations: `DURATIONS`.
        synergies: `SYNERGIES`.
        runs: `RUNS`.
        diagnostics: what was remarkable about the logs.
        further: what else there is to draw.
    """
    further = further or Further()
    kept_overlaps, left_out = _first_pairs(pair_overlaps, pair_overlaps)
    kept_synergies, _ = _first_pairs(synergies, pair_overlaps)
    synergy, seconds, ratio = _matrices(kept_overlaps, kept_synergies)
    coefficients = [
        coefficients_plot(plot, ("coefficients", *plot.agents)) for plot in synergy_coefficients(kept_synergies)
    ]
    boxes = [boxplot_plot(plot, ("durations", plot.agent or "all")) for plot in duration_boxes(intervals)]
    pages = (
        _heatmap_page("Synergy", synergy),
        Page("Coefficients", tuple(coefficients)),
        _heatmap_page("Overlap, seconds", seconds),
        _heatmap_page("Overlap, share", ratio),
        Page("Durations", tuple(boxes)),
        Page("Makespans", tuple(makespan_plot(runs, further.plan_labels))),
        Page("Fluency", tuple(fluency_plots(further.metrics, dict(runs.select("run_id", "name").iter_rows())))),
        *_settling_pages(further, pair_overlaps),
    )
    alone = () if pair_overlaps.height else ("No two agents have tasks to compare: no overlaps, no synergies.",)
    return CampaignFigures(
        campaign_id=_campaign_id(runs),
        name=f"campaign of {counted(runs.height, 'run')}",
        pages=tuple(page for page in pages if page.plots or page.steps),
        matrices=(*synergy, *seconds, *ratio),
        tables=_tables(durations, synergies, runs, diagnostics),
        facts=_facts(intervals, synergies, runs),
        captions=(*alone, *left_out),
    )


def _matrices(pair_overlaps: pl.DataFrame, synergies: pl.DataFrame) -> tuple[list[Matrix], list[Matrix], list[Matrix]]:
    """Return the matrices of synergies, of seconds together and of shares of tasks."""
    synergy_matrices = [Matrix(("synergy", *heatmap.agents), heatmap) for heatmap in synergy_heatmaps(synergies)]
    overlaps = overlap_matrices(pair_overlaps)
    seconds = [Matrix(("overlap", "seconds", *heatmap.agents), heatmap) for heatmap, _ in overlaps]
    return (
        synergy_matrices,
        seconds,
        [Matrix(("overlap", "ratio", *heatmap.agents), heatmap) for _, heatmap in overlaps],
    )


def _settling_pages(further: Further, pair_overlaps: pl.DataFrame) -> tuple[Page, Page]:
    """Return two pages: estimates as curves over the number of runs, and synergies after growing numbers of runs."""
    settling, _ = _first_pairs(further.settling, pair_overlaps)
    curves = (*settling_curves(settling, note=further.settling_note), *duration_curves(further.settling_durations))
    return Page("Settling", curves), Page(
        "Synergy over runs", steps=tuple(settling_heatmaps(settling, note=further.settling_note))
    )


def _heatmap_page(name: str, matrices: Sequence[Matrix]) -> Page:
    return Page(name, tuple(heatmap_plot(matrix.heatmap, matrix.path) for matrix in matrices))


def _first_pairs(frame: pl.DataFrame, pair_overlaps: pl.DataFrame) -> tuple[pl.DataFrame, tuple[str, ...]]:
    """Return the rows of the ordered pairs of agents that overlap most, and a caption about the other pairs."""
    pairs = frame.select("agent", "other_agent").unique()
    if pairs.height <= MAX_AGENT_PAIRS:
        return frame, ()
    overlap = pair_overlaps.group_by("agent", "other_agent").agg(pl.col("overlap_s").sum())
    by_overlap = pairs.join(overlap, on=["agent", "other_agent"], how="left").sort(
        "overlap_s", "agent", "other_agent", descending=[True, False, False], nulls_last=True
    )
    drawn_pairs = by_overlap.head(MAX_AGENT_PAIRS).select("agent", "other_agent")
    rows = frame.join(drawn_pairs, on=["agent", "other_agent"], how="semi", maintain_order="left")
    sentence = f"Matrices and coefficients of {MAX_AGENT_PAIRS} of {pairs.height} pairs of agents are drawn"
    return rows, (f"{sentence}, those that overlap most; the tables have all.",)


def _tables(
    durations: pl.DataFrame, synergies: pl.DataFrame, runs: pl.DataFrame, diagnostics: Sequence[Diagnostic]
) -> tuple[DataTable, ...]:
    diagnostic_rows = pl.DataFrame(
        [[item.severity, item.code, item.message, item.run_id, item.path] for item in diagnostics],
        schema=dict.fromkeys(("severity", "code", "message", "run_id", "path"), pl.String),
        orient="row",
    )
    run_rows = runs.with_columns(pl.col("agents").list.join(", ")).drop("start_ns", "end_ns")
    return (
        DataTable("durations", "Durations", durations.select(_TIMES), "Seconds; over executions that succeeded."),
        DataTable(
            "fits", "Fitted distributions", durations.select(_FITS), "By maximum likelihood; AIC: less is better."
        ),
        DataTable(
            "synergies", "Synergies", synergies, "Pairs that are unobserved (no overlap) or no_success have no numbers."
        ),
        DataTable("runs", "Runs", run_rows),
        DataTable("diagnostics", "Diagnostics", diagnostic_rows, "What was remarkable about the logs."),
    )


def _facts(
    intervals: pl.DataFrame, synergies: pl.DataFrame, runs: pl.DataFrame
) -> tuple[tuple[str, str | int | float], ...]:
    return (
        ("runs", runs.height),
        ("executions", intervals.height),
        ("agents", ", ".join(intervals["agent"].unique().sort())),
        ("estimator", ", ".join(synergies["estimator"].unique().sort()) or "none"),
    )


def _campaign_id(runs: pl.DataFrame) -> str:
    """Return an id of the runs, which does not depend on their order."""
    text = "\n".join(sorted(runs["run_id"].to_list()))
    return "campaign-" + hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:16]
