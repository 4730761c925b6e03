"""What n and the overlapped seconds of synergies count, and which status a pair of tasks has."""

from __future__ import annotations

from collections.abc import Mapping

import polars as pl
import pytest
from failing_cells import HOLD, SCAN, SCAN_WHILE_SCREW, SCREW, SCREW_WHILE_SCAN, cell
from hypothesis import given, settings
from hypothesis import strategies as st
from interval_frames import Row, frame, rows

from hrclog.analyzers.projections.overlaps import PAIR, overlaps, pair_overlaps
from hrclog.analyzers.synergy.estimator import Coefficient, Estimator
from hrclog.analyzers.synergy.estimators import ESTIMATORS
from hrclog.analyzers.synergy.fit import Fit
from hrclog.analyzers.synergy.observations import Observations, observe
from hrclog.analyzers.synergy.pairs import counted_pairs

SECOND = 1_000_000_000
NUMBERS = ("synergy", "std_err", "ci_low", "ci_high", "synergy_free", "free_std_err", "free_ci_low", "free_ci_high")
BAD = ("failed", "timed_out", "canceled", "skipped")
QUICK = [name for name in ESTIMATORS if name != "bayes"]

every = pytest.mark.parametrize("name", ESTIMATORS)

Key = tuple[str, str, str, str]


def estimated(name: str, found: list[Row]) -> dict[Key, Row]:
    table = ESTIMATORS[name].fit(observe(frame(found))).synergies
    return {(one["agent"], one["task"], one["other_agent"], one["other_task"]): one for one in table.to_dicts()}


def said(one: Mapping[str, object], *names: str) -> tuple[object, ...]:
    return tuple(one[name] for name in names)


SUCCEEDING = cell(lambda _: "succeeded")
WHOLE_S = sum((one["end_ns"] - one["start_ns"]) / 1e9 for one in SUCCEEDING if one["task"] == "screw") - sum(
    (one["end_ns"] - one["start_ns"]) / 1e9
    for one in SUCCEEDING
    if one["task"] == "screw" and one["end_ns"] - one["start_ns"] < 6 * SECOND
)


# --- one cell, whatever comes of the scans ---


@every
@pytest.mark.parametrize("outcome", [*BAD, "unknown"])
def test_a_task_that_never_succeeds_disturbs_as_if_it_did(name: str, outcome: str) -> None:
    expected, found = estimated(name, SUCCEEDING), estimated(name, cell(lambda _: outcome))
    one = found[SCREW_WHILE_SCAN]
    assert one == expected[SCREW_WHILE_SCAN]
    assert said(one, "n", "status") == (24, "ok")
    assert one["overlap_s"] == pytest.approx(WHOLE_S)
    other = found[SCAN_WHILE_SCREW]
    assert said(other, "n", "status", *NUMBERS) == (24, "no_success", *(None,) * 8)
    assert other["overlap_s"] == pytest.approx(WHOLE_S)
    for key, one in found.items():
        if HOLD in (key[:2], key[2:]):
            assert said(one, "n", "overlap_s", "status", *NUMBERS) == (0, 0.0, "unobserved", *(None,) * 8)


@every
def test_one_success_of_many_is_few_successes_and_disturbs_no_less(name: str) -> None:
    found = estimated(name, cell(lambda number: "succeeded" if number == 7 else "failed"))
    assert found[SCREW_WHILE_SCAN] == estimated(name, SUCCEEDING)[SCREW_WHILE_SCAN]
    other = found[SCAN_WHILE_SCREW]
    assert other["n"] == (24 if name == "aft" else 1)
    assert other["status"] in ("sparse", "weakly_identified")


@every
def test_it_is_the_same_if_the_human_is_who_fails(name: str) -> None:
    swap = {"human": "robot", "robot": "human"}
    swapped = [one | {"agent": swap[one["agent"]]} for one in cell(lambda _: "failed")]
    found = estimated(name, swapped)
    assert said(found["robot", "screw", "human", "scan"], "n", "status") == (24, "ok")
    assert said(found["human", "scan", "robot", "screw"], "n", "status") == (24, "no_success")


@every
def test_it_is_the_same_if_nobody_works_alone(name: str) -> None:
    beside = [
        one
        for one in cell(lambda _: "failed")
        if one["task"] == "scan" or (one["task"] == "screw" and one["end_ns"] - one["start_ns"] > 6 * SECOND)
    ]
    found = estimated(name, beside)
    assert set(found) == {SCREW_WHILE_SCAN, SCAN_WHILE_SCREW}
    assert said(found[SCREW_WHILE_SCAN], "n") == (24,)
    assert (
        found[SCREW_WHILE_SCAN] == estimated(name, [one | {"outcome": "succeeded"} for one in beside])[SCREW_WHILE_SCAN]
    )
    assert found[SCREW_WHILE_SCAN]["synergy"] is not None
    assert said(found[SCAN_WHILE_SCREW], "n", "status") == (24, "no_success")


@every
def test_it_is_the_same_with_a_third_agent(name: str) -> None:
    third = [
        one | {"agent": "cart", "task": "drive", "execution_id": f"cart{one['execution_id']}", "outcome": "succeeded"}
        for one in SUCCEEDING
        if one["task"] == "scan" and one["run_id"] != "run0"
    ]
    found = estimated(name, [*cell(lambda _: "timed_out"), *third])
    assert said(found[SCREW_WHILE_SCAN], "n") == (24,)
    assert found[SCREW_WHILE_SCAN]["status"] not in ("unobserved", "no_success")
    assert said(found["cart", "drive", *SCAN], "n") == (20,)
    assert said(found[*SCAN, "cart", "drive"], "n", "status") == (20, "no_success")
    assert said(found[SCAN_WHILE_SCREW], "n", "status") == (24, "no_success")


@every
def test_a_task_that_succeeds_alone_and_never_beside_the_other_says_so(name: str) -> None:
    alone = [
        one | {"start_ns": one["start_ns"] + 500 * SECOND, "end_ns": one["end_ns"] + 500 * SECOND}
        | {"until_ns": one["until_ns"] + 500 * SECOND, "execution_id": f"late{one['execution_id']}"}
        for one in SUCCEEDING
        if one["task"] == "scan"
    ]  # fmt: skip
    # an attempt that is given up halfway does not tell how long it would have taken
    failing = [
        one | {"end_ns": one["start_ns"] + 2 * SECOND, "until_ns": one["start_ns"] + 2 * SECOND}
        if one["task"] == "scan"
        else one
        for one in cell(lambda _: "failed")
    ]
    found = estimated(name, [*failing, *alone])
    assert said(found[SCAN_WHILE_SCREW], "n", "status", *NUMBERS) == (24, "no_success", *(None,) * 8)


# --- laws ---


def with_outcomes(found: list[Row], agent: str, outcomes: list[str]) -> list[Row]:
    """Return executions with other outcomes of all agents but one."""
    return [
        one if one["agent"] == agent or one["end_ns"] is None else one | {"outcome": outcome}
        for one, outcome in zip(found, outcomes, strict=True)
    ]


def change_nothing(name: str, found: list[Row], outcomes: list[str]) -> None:
    """Assert that what comes of the others' executions changes no row of an agent."""
    before, after = estimated(name, found), estimated(name, with_outcomes(found, "A", outcomes))
    assert before.keys() == after.keys()
    for key, one in before.items():
        if key[0] == "A":
            assert after[key] == one


@st.composite
def two_tellings(draw: st.DrawFn) -> tuple[list[Row], list[str]]:
    """Draw executions, and other outcomes of the same."""
    found = draw(rows(max_size=12, scale=SECOND))
    outcomes = st.sampled_from(("succeeded", *BAD))
    return found, draw(st.lists(outcomes, min_size=len(found), max_size=len(found)))


@pytest.mark.parametrize("name", QUICK)
@settings(max_examples=20)
@given(tellings=two_tellings())
def test_what_comes_of_the_others_executions_changes_nothing(name: str, tellings: tuple[list[Row], list[str]]) -> None:
    change_nothing(name, *tellings)


@pytest.mark.slow
@settings(max_examples=6)
@given(tellings=two_tellings())
def test_what_comes_of_the_others_executions_changes_nothing_for_bayes(tellings: tuple[list[Row], list[str]]) -> None:
    change_nothing("bayes", *tellings)


@pytest.mark.parametrize("name", QUICK)
@settings(max_examples=20)
@given(found=rows(max_size=14, scale=SECOND))
def test_counts_are_those_of_the_overlaps_that_the_estimator_uses(name: str, found: list[Row]) -> None:
    intervals = frame(found)
    met = overlaps(intervals)
    seen = {tuple(one[:4]): one[4:] for one in pair_overlaps(intervals, met).select(*PAIR, "n", "overlap_s").rows()}
    succeeded = {one["execution_id"] for one in found if one["outcome"] == "succeeded" and one["end_ns"] is not None}
    good = pair_overlaps(intervals, met.filter(pl.col("execution_id").is_in(list(succeeded))))
    useful = {tuple(one[:4]): one[4:] for one in good.select(*PAIR, "n", "overlap_s").rows()}
    table = estimated(name, found)
    assert table.keys() == seen.keys()
    for key, one in table.items():
        counts = seen if ESTIMATORS[name].counts_cut_short or not useful[key][0] else useful
        assert one["n"] == counts[key][0]
        assert one["overlap_s"] == pytest.approx(counts[key][1])
        assert (one["n"] > 0) == (seen[key][1] > 0)
        told = one["synergy"] is not None
        assert (
            one["status"]
            in {
                (False, False, False): {"unobserved"},
                (True, False, False): {"no_success"},
                (True, True, False): {"weakly_identified"},
                (True, False, True): {"sparse", "weakly_identified"},
                (True, True, True): {"sparse", "weakly_identified"}
                if useful[key][0] < 5
                else {"ok", "weakly_identified"},
            }[bool(seen[key][0]), bool(useful[key][0]), told]
        )


@settings(max_examples=20)
@given(found=rows(max_size=14, scale=SECOND))
def test_pairs_are_the_meetings_of_executions_that_succeeded(found: list[Row]) -> None:
    observations = observe(frame(found))
    finished = dict(observations.executions.select("execution_id", "finished").rows())
    for one in observations.meetings.to_dicts():
        assert said(one, "finished", "other_finished") == (
            finished[one["execution_id"]],
            finished[one["other_execution_id"]],
        )
    used, all_of_them = (counted_pairs(observations.meetings, cut_short=cut_short) for cut_short in (False, True))
    assert observations.pairs.equals(used.filter("finished"))
    assert all_of_them.equals(observations.meetings)


# --- estimators of one's own ---


class Guess(Estimator):
    """Says the same of one pair, and nothing of all others."""

    name = "guess"

    def fit(self, observations: Observations, outliers: str = "none") -> Fit:  # noqa: ARG002 - an estimator's signature
        """Return the guess."""
        return self.result(observations, [Coefficient(*SCREW_WHILE_SCAN, 1.5)])


class LenientGuess(Guess):
    """Uses what did not succeed too."""

    counts_cut_short = True


@pytest.mark.parametrize(("estimator", "n"), [(Guess(), 12), (LenientGuess(), 24)])
def test_what_an_estimator_does_not_tell_of_pairs_that_met_is_not_unobserved(estimator: Estimator, n: int) -> None:
    found = cell(lambda _: "succeeded")
    screws = [one for one in found if one["task"] == "screw" and one["end_ns"] - one["start_ns"] > 6 * SECOND]
    failing = {one["execution_id"] for one in screws[:12]}
    found = [one | {"outcome": "failed"} if one["execution_id"] in failing else one for one in found]
    table = estimator.fit(observe(frame(found))).synergies
    [told] = table.filter(pl.col("synergy").is_not_null()).to_dicts()
    assert said(told, *PAIR, "n", "status") == (*SCREW_WHILE_SCAN, n, "ok")
    [untold] = table.filter(agent=SCAN[0], task=SCAN[1], other_task=SCREW[1]).to_dicts()
    assert said(untold, "n", "status") == (24, "weakly_identified")
