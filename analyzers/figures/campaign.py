"""Everything drawable of many runs together."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import polars as pl

from hrclog.analyzers.figures.boxplot import BoxPlot, duration_boxes
from hrclog.analyzers.figures.coefficients import Coefficients, synergy_coefficients
from hrclog.analyzers.figures.heatmap import Heatmap
from hrclog.analyzers.figures.overlap_matrix import overlap_matrices
from hrclog.analyzers.figures.synergy_heatmap import synergy_heatmaps
from hrclog.analyzers.figures.table import DataTable
from hrclog.diagnostic import Diagnostic

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
class CampaignFigures:
    """The pictures of a campaign; one entry per ordered pair of agents in overlaps, synergies and coefficients."""

    campaign_id: str
    name: str
    synergies: tuple[Heatmap, ...]
    coefficients: tuple[Coefficients, ...]
    overlaps: tuple[tuple[Heatmap, Heatmap], ...]
    durations: tuple[BoxPlot, ...]
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
) -> CampaignFigures:
    """Return the figures of a campaign.

    Args:
        intervals: schema `INTERVALS`, as are the others of the schema of their name.
        pair_overlaps: `PAIR_OVERLAPS`.
        durations: `DURATIONS`.
        synergies: `SYNERGIES`.
        runs: `RUNS`.
        diagnostics: what was remarkable about the logs.
    """
    kept_overlaps, left_out = _first_pairs(pair_overlaps)
    kept_synergies, _ = _first_pairs(synergies)
    alone = () if pair_overlaps.height else ("No two agents have tasks to compare: no overlaps, no synergies.",)
    return CampaignFigures(
        campaign_id=_campaign_id(runs),
        name=f"campaign of {runs.height:,} run{'' if runs.height == 1 else 's'}",
        synergies=tuple(synergy_heatmaps(kept_synergies)),
        coefficients=tuple(synergy_coefficients(kept_synergies)),
        overlaps=tuple(overlap_matrices(kept_overlaps)),
        durations=tuple(duration_boxes(intervals)),
        tables=_tables(durations, synergies, runs, diagnostics),
        facts=_facts(intervals, synergies, runs),
        captions=(*alone, *left_out),
    )


def _first_pairs(frame: pl.DataFrame) -> tuple[pl.DataFrame, tuple[str, ...]]:
    pairs = frame.select("agent", "other_agent").unique().sort("agent", "other_agent")
    if pairs.height <= MAX_AGENT_PAIRS:
        return frame, ()
    kept = frame.join(pairs.head(MAX_AGENT_PAIRS), on=["agent", "other_agent"], how="semi", maintain_order="left")
    drawn = f"Matrices and coefficients of the first {MAX_AGENT_PAIRS} of {pairs.height} pairs of agents are drawn"
    return kept, (f"{drawn}; the tables have all.",)


def _tables(
    durations: pl.DataFrame, synergies: pl.DataFrame, runs: pl.DataFrame, diagnostics: Sequence[Diagnostic]
) -> tuple[DataTable, ...]:
    found = pl.DataFrame(
        [[item.severity, item.code, item.message, item.run_id, item.path] for item in diagnostics],
        schema=dict.fromkeys(("severity", "code", "message", "run_id", "path"), pl.String),
        orient="row",
    )
    spoken = runs.with_columns(pl.col("agents").list.join(", ")).drop("start_ns", "end_ns")
    return (
        DataTable("durations", "Durations", durations.select(_TIMES), "Seconds; over executions that succeeded."),
        DataTable(
            "fits", "Fitted distributions", durations.select(_FITS), "By maximum likelihood; AIC: less is better."
        ),
        DataTable("synergies", "Synergies", synergies, "Unobserved pairs have no numbers."),
        DataTable("runs", "Runs", spoken),
        DataTable("diagnostics", "Diagnostics", found, "What was remarkable about the logs."),
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
    """Return an id that is the same for the same runs, in whatever order."""
    text = "\n".join(sorted(runs["run_id"].to_list()))
    return "campaign-" + hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:16]
