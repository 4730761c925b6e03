"""Forecast one execution's duration from its start, its model and what the others do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from hrclog.analyzers.prediction.scoring_rules import HIGH, LEVELS, LOW, crps, interval_score
from hrclog.analyzers.prediction.timelines import Timeline
from hrclog.analyzers.synergy.log_work import LogWork

_ALL: Final = np.concatenate([LEVELS, [LOW, 0.5, HIGH]])


@dataclass(frozen=True, slots=True)
class Scored:
    """A forecast, in seconds, and how it did."""

    mean_s: float
    median_s: float
    low_s: float  # ends of the 90 % interval
    high_s: float
    crps_s: float
    interval_score_s: float
    log_density: float  # of what was observed


def score_forecast(timeline: Timeline, log_work: LogWork, observed_s: float) -> Scored:
    """Forecast a duration and score it against the observed one.

    The forecast's quantiles D_q solve W(D_q) = exp(q-quantile of log W).

    Args:
        timeline: what the others do, under the model's factors.
        log_work: how log W is distributed.
        observed_s: the duration that was observed.
    """
    durations = timeline.time_for(np.exp(log_work.quantile(_ALL)))
    quantiles, (low, median, high) = durations[: len(LEVELS)], durations[len(LEVELS) :].tolist()
    log_w = np.log(timeline.work_after(observed_s))
    density = float(log_work.log_density(np.array([log_w]))[0]) - log_w - timeline.log_factor_before(observed_s)
    return Scored(
        mean_s=float(quantiles.mean()),
        median_s=median,
        low_s=low,
        high_s=high,
        crps_s=crps(quantiles, observed_s),
        interval_score_s=interval_score(low, high, observed_s),
        log_density=float(density),
    )
