"""The default estimator: simulated truths are recovered, and what cannot be learnt is not told."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from interval_frames import Row, frame, random_runs, row
from polars.testing import assert_frame_equal
from scipy.special import stdtrit
from simulated_frames import Key, simulated, simulated_frame

from hrclog.analyzers.synergy import aft as module
from hrclog.analyzers.synergy.aft import LEAST_LEARNT, TaskFit, aft, fit_task
from hrclog.analyzers.synergy.aft_likelihood import Prior, log_posterior
from hrclog.analyzers.synergy.exposures import Exposure, exposures
from hrclog.analyzers.synergy.fit import Fit
from hrclog.analyzers.synergy.observations import merge, observe

SECOND = 1_000_000_000

WORK = {"H": {"a": (1.5, 0.2), "b": (1.2, 0.15)}, "R": {"x": (1.6, 0.1), "y": (1.3, 0.1)}}
FACTORS: dict[Key, float] = {
    ("H", "a", "R", "x"): 1.8,
    ("H", "a", "R", "y"): 3.0,
    ("H", "b", "R", "x"): 0.7,
    ("R", "x", "H", "a"): 1.4,
}
NUMBERS = ("synergy", "std_err", "ci_low", "ci_high")
FREE_NUMBERS = ("synergy_free", "free_std_err", "free_ci_low", "free_ci_high")


@pytest.fixture(autouse=True)
def no_warnings() -> Iterator[None]:
    """Make every warning an error, whatever the runner is told."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def by_key(found: Fit) -> dict[Key, Row]:
    return {
        (one["agent"], one["task"], one["other_agent"], one["other_task"]): one for one in found.synergies.to_dicts()
    }


def fitted(found: list[Row], **others: object) -> dict[Key, Row]:
    return by_key(aft(observe(frame(found)), **others))


def values(one: Row, *names: str) -> tuple[float | None, ...]:
    return tuple(one[name] for name in names)


def alike(first: dict[Key, Row], second: dict[Key, Row], rel: float = 1e-6) -> None:
    """Assert that two tables tell the same numbers."""
    assert first.keys() == second.keys()
    for key, one in first.items():
        other = second[key]
        assert values(one, "n", "status") == values(other, "n", "status")
        for name in (*NUMBERS, *FREE_NUMBERS, "overlap_s"):
            assert one[name] == (None if other[name] is None else pytest.approx(other[name], rel=rel)), (key, name)


# --- truth ---


def test_simulated_factors_are_recovered() -> None:
    found = by_key(aft(observe(simulated_frame(1, 300, WORK, FACTORS))))
    assert len(found) == 8
    for key, one in found.items():
        assert one["synergy_free"] == pytest.approx(FACTORS.get(key, 1.0), rel=0.06)
        assert one["status"] == "ok"


def test_the_distribution_of_work_is_recovered() -> None:
    models = aft(observe(simulated_frame(1, 300, WORK, FACTORS))).models
    assert set(models) == {("H", "a"), ("H", "b"), ("R", "x"), ("R", "y")}
    for (agent, task), model in models.items():
        mu, sigma = WORK[agent][task]
        assert model.log_work.center == pytest.approx(mu, abs=0.03)
        assert model.log_work.deviation == pytest.approx(sigma, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("n_runs", [4, 30])
def test_intervals_cover_the_truth_as_often_as_they_say(n_runs: int) -> None:
    hits = []
    for seed in range(30):
        for key, one in by_key(aft(observe(simulated_frame(seed, n_runs, WORK, FACTORS)))).items():
            if one["synergy_free"] is not None:
                hits.append(one["free_ci_low"] <= FACTORS.get(key, 1.0) <= one["free_ci_high"])
    assert len(hits) > 200
    assert 0.91 < np.mean(hits) < 0.99


def test_synergy_is_the_expected_duration_beside_the_other_over_the_mean_duration() -> None:
    intervals = simulated_frame(2, 20, WORK, FACTORS)
    result = aft(observe(intervals))
    mean = intervals.group_by("agent", "task").agg(((pl.col("end_ns") - pl.col("start_ns")) / 1e9).mean())
    mean_s = {(agent, task): value for agent, task, value in mean.rows()}
    for key, one in by_key(result).items():
        model = result.models[key[:2]]
        mu, sigma = model.log_work.center, model.log_work.deviation
        factor = math.exp(model.log_factors[key[2:]])
        assert one["synergy_free"] == pytest.approx(factor, rel=1e-12)
        assert one["synergy"] == pytest.approx(math.exp(mu + sigma**2 / 2) * factor / mean_s[key[:2]], rel=1e-12)


def test_intervals_are_students_on_the_logarithm_of_what_the_covariances_say() -> None:
    observations = observe(simulated_frame(2, 3, WORK, FACTORS))
    result, fits = aft(observations), {data.key: fit_task(data, Prior()) for data in exposures(observations)}
    table = by_key(result)
    for covariance in result.covariances:
        assert covariance.parameters[:2] == ("mu", "log_sigma")
        for number, key in enumerate(covariance.parameters[2:], start=2):
            assert isinstance(key, tuple)
            one, fit = table[key], fits[key[:2]]
            if one["synergy_free"] is None:
                continue
            np.testing.assert_array_equal(covariance.matrix, fit.covariance)
            both = (fit.covariance, fit.mean_covariance)
            deviation = math.sqrt(max(matrix[number, number] for matrix in both))
            assert one["free_std_err"] == pytest.approx(one["synergy_free"] * deviation)
            half = stdtrit(fit.freedom, 0.975) * deviation
            assert math.log(one["free_ci_high"] / one["synergy_free"]) == pytest.approx(half)
            assert math.log(one["synergy_free"] / one["free_ci_low"]) == pytest.approx(half)
            # of mu + sigma^2 / 2 + log s
            slope = np.zeros(len(fit.parameters))
            slope[[0, 1, number]] = 1.0, fit.sigma**2, 1.0
            widest = math.sqrt(max(slope @ matrix @ slope for matrix in both))
            assert one["std_err"] == pytest.approx(one["synergy"] * widest)


def test_factors_of_agents_at_work_together_multiply() -> None:
    work = {"H": {"h": (1.5, 0.15)}, "R": {"x": (1.4, 0.2), "y": (1.2, 0.2)}, "S": {"u": (1.5, 0.2)}}
    factors = {("H", "h", "R", "x"): 1.7, ("H", "h", "S", "u"): 2.2, ("S", "u", "R", "y"): 0.6}
    intervals = simulated_frame(4, 200, work, factors)
    data = next(data for data in exposures(observe(intervals)) if data.key == ("H", "h"))
    assert data.seconds.sum(axis=0)[(data.members > 0).sum(axis=1) == 2].sum() > 0.2 * data.seconds.sum()
    for key, one in by_key(aft(observe(intervals))).items():
        assert one["synergy_free"] == pytest.approx(factors.get(key, 1.0), rel=0.06)


@pytest.mark.parametrize("factor", [1e-3, 1e-2, 20.0])
def test_enormous_factors_are_found_where_there_is_time_beside_the_other(factor: float) -> None:
    # a prior that does not mind
    work = {"H": {"h": (0.0, 0.1)}, "R": {"x": (0.0, 0.1), "y": (0.0, 0.1)}}
    intervals = simulated_frame(2, 150, work, {("H", "h", "R", "x"): factor})
    found = by_key(aft(observe(intervals), prior=Prior(tau=10.0)))
    assert found["H", "h", "R", "x"]["synergy_free"] == pytest.approx(factor, rel=0.1)
    assert found["H", "h", "R", "y"]["synergy_free"] == pytest.approx(1.0, rel=0.05)


def test_failures_told_as_censored_bias_less_than_failures_left_out() -> None:
    work = {"H": {"h": (1.5, 0.5)}, "R": {"x": (1.4, 0.2)}}
    truth = {("H", "h", "R", "x"): 2.0}
    found = simulated(3, 300, work, truth, failures_per_s=0.15)
    failed = sum(one["outcome"] == "failed" for one in found if one["agent"] == "H")
    assert 0.3 < failed / 2400 < 0.7
    told = aft(observe(frame(found)))
    # whoever drops failures knows nothing of H's, but R's go on being there
    left_out = [one for one in found if one["outcome"] == "succeeded" or one["agent"] == "R"]
    dropped = aft(observe(frame(left_out)))
    beside = [
        model.log_work.center + model.log_factors["R", "x"] - (1.5 + math.log(2.0))
        for model in (told.models["H", "h"], dropped.models["H", "h"])
    ]
    alone = [fit.models["H", "h"].log_work.center - 1.5 for fit in (told, dropped)]
    for ours, theirs in (beside, alone):
        assert abs(ours) < 0.06
        assert theirs < -0.15
    assert told.models["H", "h"].log_factors["R", "x"] == pytest.approx(math.log(2.0), abs=0.08)


# --- what must not matter ---

FOUND = simulated(6, 12, WORK, FACTORS, failures_per_s=0.01)


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_the_unit_of_time_does_not_matter(unit: float) -> None:
    times = ("start_ns", "end_ns", "until_ns")
    scaled = [one | {name: round(one[name] * unit) for name in times} for one in FOUND]
    first, second = aft(observe(frame(FOUND))), aft(observe(frame(scaled)))
    drop = {key: one | {"overlap_s": 0.0} for key, one in by_key(first).items()}
    alike(drop, {key: one | {"overlap_s": 0.0} for key, one in by_key(second).items()}, rel=1e-4)
    for key, model in first.models.items():
        assert second.models[key].log_work.center == pytest.approx(model.log_work.center + math.log(unit), abs=1e-5)


def test_order_shift_and_sharding_change_no_bit() -> None:
    whole = aft(observe(frame(FOUND))).synergies
    mixed = observe(frame(FOUND).sample(fraction=1.0, shuffle=True, seed=1))
    later = observe(frame(FOUND).with_columns(pl.col("start_ns", "end_ns", "until_ns") + 1_700_000_000_123_456_789))
    runs = sorted({one["run_id"] for one in FOUND})
    shards = merge([observe(frame([one for one in FOUND if one["run_id"] in runs[k::3]])) for k in range(3)])
    for same in (mixed, later, shards):
        assert_frame_equal(aft(same).synergies, whole, check_exact=True)


def test_names_are_only_names() -> None:
    agents = {"H": "机器人 ü", "R": "0"}
    tasks = {"a": "z\n", "b": "y,", "x": "same", "y": " "} | {"b": "same"}  # a task of both agents
    renamed = [one | {"agent": agents[one["agent"]], "task": tasks[one["task"]]} for one in FOUND]
    first = fitted(FOUND)
    back = {(agents[a], tasks[t], agents[b], tasks[u]): one for (a, t, b, u), one in first.items()}
    alike(fitted(renamed), dict(sorted(back.items())))


def test_the_names_of_runs_and_executions_do_not_matter() -> None:
    count = len(FOUND)
    renamed = [
        one | {"run_id": one["run_id"][::-1], "execution_id": f"{count - number:05}"}
        for number, one in enumerate(FOUND)
    ]
    alike(fitted(renamed), fitted(FOUND))


def test_another_task_that_nobody_is_beside_changes_nothing() -> None:
    alone = [row("R", "z", 10**15, 10**15 + SECOND, run_id=run) for run in {one["run_id"] for one in FOUND}]
    found = fitted(FOUND + alone)
    old = fitted(FOUND)
    alike({key: one for key, one in found.items() if "z" not in key}, old)
    for key in found.keys() - old.keys():
        assert values(found[key], "n", "status", *NUMBERS, *FREE_NUMBERS) == (0, "unobserved", *(None,) * 8)


# --- what cannot be learnt ---


def test_beside_an_agent_that_never_idles_only_the_product_is_known() -> None:
    found = simulated(1, 80, WORK | {"R": {"x": (1.6, 0.4), "y": (1.0, 0.4)}}, FACTORS, idle_s=1e-9)
    ends: dict[tuple[str, str], int] = {}
    for one in found:
        key = one["run_id"], one["agent"]
        ends[key] = max(ends.get(key, 0), one["end_ns"])
    # H's executions after R's last one are not beside a busy R
    found = [one for one in found if one["agent"] == "R" or one["end_ns"] <= ends[one["run_id"], "R"]]
    result = aft(observe(frame(found)))
    table = by_key(result)
    for key in [key for key in table if key[0] == "H"]:
        one, model = table[key], result.models[key[:2]]
        assert one["status"] == "weakly_identified"
        assert values(one, *FREE_NUMBERS) == (None,) * 4
        assert None not in values(one, *NUMBERS)
        product = math.exp(model.log_work.center + model.log_factors[key[2:]])
        assert product == pytest.approx(math.exp(WORK[key[0]][key[1]][0]) * FACTORS.get(key, 1.0), rel=0.1)
        assert one["ci_low"] < one["synergy"] < one["ci_high"]


@pytest.mark.parametrize(("idle_s", "share", "statuses"), [(0.15, 0.05, {"weakly_identified"}), (0.9, 0.18, {"ok"})])
def test_a_tenth_of_idle_time_is_needed_for_the_free_factor(idle_s: float, share: float, statuses: set[str]) -> None:
    # so many runs that the free factor is estimated well even so: by what the model says of the rare idle moments
    found = simulated(1, 400, WORK, FACTORS, idle_s=idle_s)
    last = {(one["run_id"], one["agent"]): one["end_ns"] for one in sorted(found, key=lambda one: one["end_ns"])}
    found = [one for one in found if one["agent"] == "R" or one["end_ns"] <= last[one["run_id"], "R"]]
    observations = observe(frame(found))
    of_h = observations.executions.filter(agent="H", task="a").explode("state", "seconds")
    idle = observations.states.index(())
    assert of_h.filter(state=idle)["seconds"].sum() / of_h["seconds"].sum() == pytest.approx(share, abs=0.04)
    table = by_key(aft(observations))
    assert {table["H", "a", "R", other]["status"] for other in "xy"} == statuses
    for other in "xy":
        assert table["H", "a", "R", other]["synergy"] is not None


def inseparable() -> list[Row]:
    """Return runs in which r and s, of two agents, are always there together: h takes twice as long beside both."""
    source = np.random.default_rng(0)
    found = []
    for run in range(60):
        work, wait, length = math.exp(source.normal(2.0, 0.1)), source.uniform(0, 6), source.uniform(0, 8)
        span = (round(wait * SECOND), round((wait + length) * SECOND))
        end = work + min(max(work - wait, 0), length / 2)
        found.append(row("H", "h", 0, round(end * SECOND), run_id=f"{run}", execution_id=f"h{run}"))
        found += [row(one, one.lower(), *span, run_id=f"{run}", execution_id=f"{one}{run}") for one in "RS"]
    return found


def test_of_tasks_that_always_come_together_only_the_product_is_known() -> None:
    result = aft(observe(frame(inseparable())))
    factors = result.models["H", "h"].log_factors
    assert factors["R", "r"] + factors["S", "s"] == pytest.approx(math.log(2.0), abs=0.1)
    covariance = next(one for one in result.covariances if one.parameters[2][0] == "H").matrix
    assert covariance[2, 3] / math.sqrt(covariance[2, 2] * covariance[3, 3]) < -0.95
    for one in by_key(result).values():
        if one["agent"] == "H" and one["synergy_free"] is not None:
            assert one["free_ci_low"] < 1.0
            assert one["free_ci_high"] > 2.0


def test_tasks_that_always_come_together_are_weakly_identified() -> None:
    table = fitted(inseparable())
    assert [table["H", "h", *other]["status"] for other in (("R", "r"), ("S", "s"))] == ["weakly_identified"] * 2


def test_a_task_met_once_is_drawn_towards_no_effect() -> None:
    found = simulated(1, 20, {"H": {"h": (1.0, 0.2)}, "R": {"x": (1.0, 0.2)}})
    # once, and very slow: 20 s of which 19 beside z, instead of 2.7 s
    odd = [
        row("H", "h", 0, 20 * SECOND, run_id="odd", execution_id="h"),
        row("R", "z", SECOND, 20 * SECOND, run_id="odd", execution_id="z"),
    ]
    observations = observe(frame(found + odd))
    fits = [aft(observations, prior=Prior(tau=tau)) for tau in (0.01, 0.1, 0.3, 0.75, 3.0)]
    factors = [math.exp(fit.models["H", "h"].log_factors["R", "z"]) for fit in fits]
    assert factors == sorted(factors)
    assert factors[0] == pytest.approx(1.0, abs=0.01)
    assert 1.0 < factors[3] < factors[4] < 19 / (math.e - 1)
    assert values(by_key(fits[3])["H", "h", "R", "z"], "status", "n") == ("sparse", 1)


@pytest.mark.slow
def test_where_there_is_no_effect_few_observations_do_not_invent_one() -> None:
    tables = [by_key(aft(observe(simulated_frame(seed, 2, WORK, per_agent=3)))) for seed in range(30)]
    told = [one for table in tables for one in table.values() if one["synergy_free"] is not None]
    assert len(told) > 100
    assert np.mean([one["free_ci_low"] < 1.0 < one["free_ci_high"] for one in told]) > 0.9
    assert np.median([abs(math.log(one["synergy_free"])) for one in told]) < 0.25


@pytest.mark.parametrize("spread", [0.1, 0.05, 0.02, 0.005, 0.0])
def test_runs_that_are_all_alike_tell_nothing_of_factors(spread: float) -> None:
    source = np.random.default_rng(1)
    found = []
    for run in range(50):
        end = round(4 * SECOND * math.exp(spread * source.normal()))
        found.append(row("H", "h", 0, end, run_id=f"{run}", execution_id=f"h{run}"))
        found.append(row("R", "r", 2 * SECOND, 6 * SECOND, run_id=f"{run}", execution_id=f"r{run}"))
    one = fitted(found)["H", "h", "R", "r"]
    assert values(one, "status", "synergy_free") == ("weakly_identified", None)
    assert one["ci_low"] < 0.6
    assert one["ci_high"] > 1.8
    assert one["synergy"] == pytest.approx(
        1.0, abs=max(2 * spread, 1e-3)
    )  # drawn to no effect, not to the prior's spread


# --- what is odd ---


def times(count: int, *spans: tuple[str, str, int, int], **others: object) -> list[Row]:
    """Return the same executions in several runs."""
    return [
        row(agent, task, start, end, run_id=f"{run}", execution_id=f"{run}-{number}", **others)
        for run in range(count)
        for number, (agent, task, start, end) in enumerate(spans)
    ]


PAIR = (("H", "h", 0, 4 * SECOND), ("R", "r", 2 * SECOND, 5 * SECOND))

ODD: dict[str, list[Row]] = {
    "nothing": [],
    "one execution": times(1, PAIR[0]),
    "one pair": times(1, *PAIR),
    "one run": simulated(1, 1, WORK, FACTORS, per_agent=6),
    "two runs": times(2, *PAIR),
    "identical durations": times(50, *PAIR),
    "identical durations beside": times(50, ("H", "h", 0, SECOND), ("R", "r", 0, SECOND)),
    "a nanosecond": times(50, ("H", "h", 0, 1), ("R", "r", 0, 1)),
    "no length": times(4, ("H", "h", 5, 5), ("R", "r", 5, 5)),
    "some without length": times(4, ("H", "h", 5, 5), ("R", "r", 5, 5), ("H", "h", 5, 9), ("R", "r", 6, 12)),
    "one agent": random_runs(1, n_runs=4, agents="H"),
    "no overlaps": times(9, ("H", "h", 0, SECOND), ("R", "r", SECOND, 2 * SECOND)),
    "all failed": times(5, *PAIR, outcome="failed"),
    "all open": [one | {"end_ns": None, "outcome": "unknown"} for one in times(5, *PAIR)],
    "nanoseconds to days": [
        row(agent, "t", 0, 10 ** (k % most), run_id=f"{k}", execution_id=f"{agent}{k}")
        for k in range(40)
        for agent, most in (("H", 14), ("R", 13))
    ],
    "no noise": simulated(1, 20, {"H": {"h": (0, 0)}, "R": {"x": (0, 0), "y": (1, 0)}}, {("H", "h", "R", "x"): 2.0}),
    "a lot of noise": simulated(1, 20, {"H": {"h": (0, 3)}, "R": {"x": (0, 3)}}),
    "a standstill": simulated(1, 40, {"H": {"h": (0, 0.2)}, "R": {"x": (0, 0.2)}}, {("H", "h", "R", "x"): 1e3}),
    "a burst": simulated(1, 40, {"H": {"h": (0, 0.2)}, "R": {"x": (0, 0.2)}}, {("H", "h", "R", "x"): 1e-3}),
    "many tasks": random_runs(1, n_runs=3, per_agent=10, tasks=10),
    "everyone overlaps himself": random_runs(1, 3, tasks=2, agents="HRS", overlap_itself="HRS"),
    "hours": [one | {name: one[name] * 3600 for name in ("start_ns", "end_ns", "until_ns")} for one in random_runs(2)],
}
outliers = pytest.mark.parametrize("method", ["none", "isolation-forest"])


@pytest.mark.slow
@outliers
@pytest.mark.parametrize("name", ODD)
def test_odd_runs_give_numbers_that_make_sense_or_none(name: str, method: str) -> None:
    result = aft(observe(frame(ODD[name])), method)
    for one in result.synergies.to_dicts():
        for names in (NUMBERS, FREE_NUMBERS):
            numbers = values(one, *names)
            if numbers[0] is None:
                assert numbers == (None,) * 4
                continue
            value, error, low, high = numbers
            assert np.isfinite(numbers).all()
            assert 0 < low < value < high
            log_s = result.models[one["agent"], one["task"]].log_factors[one["other_agent"], one["other_task"]]
            # known well, or clearly an effect
            assert 0 < error < max(LEAST_LEARNT * Prior().tau, abs(log_s) / 1.9) * value
        assert (one["status"] == "unobserved") == (one["n"] == 0)
        assert one["n"] > 0 or one["synergy"] is None
        assert (one["synergy_free"] is not None) == (one["status"] in ("ok", "sparse"))
    for model in result.models.values():
        quantiles = model.log_work.quantile(np.array([0.01, 0.5, 0.99]))
        assert np.isfinite(quantiles).all()
        assert (np.diff(quantiles) > 0).all()
        assert np.isfinite(list(model.log_factors.values())).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", ODD)
def test_odd_runs_are_fitted_at_a_maximum(name: str) -> None:
    for data in exposures(observe(frame(ODD[name]))):
        if not data.finished.any():
            continue
        found = fit_task(data, Prior())
        gradient = log_posterior(found.parameters, data, Prior(), found.spent).gradient
        assert np.abs(gradient).max() < 1e-4 + 1e-5 * len(data.finished)
        np.testing.assert_allclose(found.covariance, found.covariance.T, rtol=1e-6, atol=1e-12)
        for covariance in (found.covariance, found.mean_covariance):
            assert np.linalg.eigvalsh(covariance).min() > 0
        assert found.freedom >= 1
        assert found.sigma > 0


def test_a_task_that_never_succeeded_has_no_model_and_no_numbers_but_others_do() -> None:
    found = [one | {"outcome": "failed"} if one["task"] == "a" else one for one in simulated(1, 20, WORK, FACTORS)]
    result = aft(observe(frame(found)))
    assert set(result.models) == {("H", "b"), ("R", "x"), ("R", "y")}
    for key, one in by_key(result).items():
        assert one["n"] > 0
        if key[:2] == ("H", "a"):
            assert values(one, "status", *NUMBERS, *FREE_NUMBERS) == ("no_success", *(None,) * 8)
        else:
            assert one["status"] == "ok"
    # what the other does counts, whatever came of it: R's x is slower beside it
    assert result.models["R", "x"].log_factors["H", "a"] == pytest.approx(math.log(1.4), abs=0.1)


def test_a_run_left_alone_has_an_estimate_for_what_it_saw() -> None:
    table = fitted(simulated(5, 1, WORK, FACTORS, per_agent=30))
    assert {one["status"] for one in table.values()} <= {"ok", "sparse"}


@pytest.mark.slow
def test_the_forest_leaves_out_successes_only_and_gives_the_same_each_time() -> None:
    observations = observe(frame(FOUND))
    first, second, none = (aft(observations, method) for method in ("isolation-forest", "isolation-forest", "none"))
    assert_frame_equal(first.synergies, second.synergies, check_exact=True)
    assert first.synergies["n"].to_list() == none.synergies["n"].to_list()
    assert first.synergies["synergy"].to_list() != none.synergies["synergy"].to_list()
    for data in exposures(observations):
        kept = module.inlying(data, "isolation-forest")
        assert (~kept.finished).sum() == (~data.finished).sum()
        assert 0 < kept.finished.sum() < data.finished.sum()


@pytest.mark.parametrize("which", ["covariance", "mean_covariance"])
def test_a_covariance_that_is_none_teaches_nothing(which: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def nowhere(data: Exposure, prior: Prior) -> TaskFit:
        fit = fit_task(data, prior)
        return replace(fit, **{which: -getattr(fit, which)})

    observations = observe(frame(FOUND))
    monkeypatch.setattr(module, "fit_task", nowhere)
    table = aft(observations).synergies
    assert table["synergy"].null_count() == table["synergy_free"].null_count() == table.height
    assert set(table["status"]) == {"weakly_identified"}


@pytest.mark.slow
def test_sixty_tasks_of_each_agent_are_fitted() -> None:
    result = aft(observe(frame(random_runs(1, n_runs=30, per_agent=60, tasks=60))))
    assert result.synergies.height == 2 * 60 * 60
    factors = result.synergies["synergy_free"].drop_nulls()
    assert factors.len() > 100  # most met each other once or twice
    assert factors.is_between(0.1, 10.0).all()


@pytest.mark.slow
def test_a_hundred_thousand_executions_are_fitted() -> None:
    table = by_key(aft(observe(simulated_frame(1, 6000, WORK, FACTORS))))
    for key, one in table.items():
        assert one["synergy_free"] == pytest.approx(FACTORS.get(key, 1.0), rel=0.02)
