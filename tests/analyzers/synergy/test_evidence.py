"""The width of the factors' prior, chosen by what makes the executions most likely."""

from __future__ import annotations

import math

import numpy as np
import pytest
from interval_frames import frame
from scipy.integrate import dblquad
from simulated_frames import simulated

from hrclog.analyzers.learning.learn import learn
from hrclog.analyzers.synergy.aft import aft, fit_task
from hrclog.analyzers.synergy.aft_likelihood import Prior, log_posterior
from hrclog.analyzers.synergy.evidence import WIDTHS, fit_by_evidence, log_evidence
from hrclog.analyzers.synergy.exposures import Exposure, exposures
from hrclog.analyzers.synergy.observations import observe

WORK = {"H": {"walk": (1.6, 0.15), "reach": (1.2, 0.15)}, "R": {"pick": (1.5, 0.1), "place": (1.3, 0.1)}}
HARM = {("R", "pick", "H", "reach"): 3.0, ("R", "place", "H", "reach"): 2.5}


def _data(seed: int = 3, idle_s: float = 0.2) -> dict[tuple[str, str], Exposure]:
    rows = simulated(seed, 30, WORK, HARM, idle_s=idle_s)
    return {data.key: data for data in exposures(observe(frame(rows)))}


def test_a_task_that_nobody_affects_gets_the_narrowest_prior_and_one_that_somebody_does_the_widest() -> None:
    data = _data()
    for task in ("walk", "reach"):
        assert fit_by_evidence(data["H", task]).log_s == pytest.approx(
            fit_task(data["H", task], Prior(tau=WIDTHS[0])).log_s
        )
    found = fit_by_evidence(data["R", "pick"])
    assert found.log_s == pytest.approx(fit_task(data["R", "pick"], Prior(tau=WIDTHS[-1])).log_s)
    assert math.exp(found.log_s[found.data.others.index(("H", "reach"))]) == pytest.approx(3.0, rel=0.25)


def test_work_is_known_better_where_others_hardly_ever_idle() -> None:
    errors = []
    for seed in range(4):
        data = _data(seed)
        for (agent, task), one in data.items():
            true = WORK[agent][task][0]
            errors.append((fit_by_evidence(one).mu - true, fit_task(one, Prior()).mu - true))
    by_evidence, fixed = np.sqrt(np.square(errors).mean(axis=0))
    assert by_evidence < 0.8 * fixed


@pytest.mark.slow
def test_the_evidence_is_the_integral_over_parameters_up_to_a_constant() -> None:
    """Of two parameters, the spread known: the ratio of evidences of two widths by quadrature and by Laplace."""
    data = _data()["R", "pick"]
    one = Exposure(data.key, data.others[:1], data.seconds, data.members[:, :1], data.last, data.finished)
    (narrow, narrow_told), (wide, wide_told) = (_evidences(one, Prior(tau=tau)) for tau in (0.2, 0.75))
    assert wide_told - narrow_told == pytest.approx(wide - narrow, abs=0.05)


def _evidences(data: Exposure, prior: Prior) -> tuple[float, float]:
    """Return the log evidence by quadrature over mu and one factor, and by Laplace's approximation."""
    fit = fit_task(data, prior)
    mu, log_sigma, log_s = fit.parameters
    top = log_posterior(fit.parameters, data, prior, fit.spent).value

    def density(factor: float, center: float) -> float:
        return math.exp(log_posterior(np.array([center, log_sigma, factor]), data, prior, fit.spent).value - top)

    wide, high = 7 * np.sqrt(np.diag(fit.covariance))[[0, 2]]
    volume, _ = dblquad(density, mu - wide, mu + wide, log_s - high, log_s + high)
    return math.log(volume) + top - math.log(prior.tau), log_evidence(fit, prior)


def test_planning_uses_it_and_the_table_does_not() -> None:
    intervals = frame(simulated(3, 30, WORK, HARM, idle_s=0.2))
    found = learn(intervals)
    table = aft(observe(intervals)).synergies
    assert found.synergies.equals(table)
    factors = {(f.other_agent, f.other_task): f.log_s for f in found.times.times["H", "walk"].factors}
    assert max(map(abs, factors.values())) < 0.1
