"""The outcomes of a dump: none is taken for a failure without a word."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hrclog.analyzers.projections.intervals import intervals
from hrclog.errors import HrclogError
from hrclog.events import Outcome
from hrclog.log.reader import read_logs
from hrclog.recorders.importers.mongo import Mongo
from hrclog.recorders.importers.mongo_outcomes import Outcomes
from hrclog.recorders.importers.writing import import_files

WORDS = [outcome.value for outcome in Outcome]
VALUES = st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.lists(st.integers(), max_size=2)
ROW = {"name": "pick", "agent": "R", "recipe": "r", "t_start": 1_700_000_000, "t_end": 1_700_000_004.5}


@given(VALUES)
def test_an_outcome_is_known_or_told(value: object) -> None:
    outcomes, row = Outcomes(), {"outcome": value}
    told = outcomes.diagnostics([(Path("dump.json"), row)] * 3)
    plain = str(value).strip().casefold() if isinstance(value, str) else value
    known = plain in (0, 1, "0", "1", "true", "false", *WORDS) if not isinstance(plain, list) else False
    assert [diagnostic.code for diagnostic in told] == ([] if known else ["unknown_outcome"])
    if told:
        assert "3 executions" in told[0].message
        assert f"it counts as {outcomes.of(row) or 'unknown'}" in told[0].message
        assert outcomes.of(row) != "succeeded"
        assert outcomes.reason(row)


@pytest.mark.parametrize("value", [1, 1.0, True, "1", " Succeeded "])
def test_what_plainly_is_a_success_is_one(value: object) -> None:
    assert Outcomes().of({"outcome": value}) == "succeeded"
    assert Outcomes().reason({"outcome": value}) == ""


@given(st.text(min_size=1).filter(lambda text: bool(text.strip())), st.sampled_from(["ok", "failed", "canceled"]))
def test_a_word_that_is_explained_has_that_meaning(word: str, option: str) -> None:
    outcomes = Outcomes(**{option: [word]})
    meaning = {"ok": "succeeded"}.get(option, option)
    for written in (word, word.strip()):
        assert outcomes.of({"outcome": written}) == meaning
        assert outcomes.diagnostics([(Path(), {"outcome": written})]) == []


def test_a_number_may_be_explained_too() -> None:
    outcomes = Outcomes(ok=["3"], canceled=["-1", "0.5"])
    assert [outcomes.of({"outcome": value}) for value in (3, 3.0, "3", -1, 0.5, 4)] == [
        "succeeded",
        "succeeded",
        "succeeded",
        "canceled",
        "canceled",
        "failed",
    ]


def test_one_word_cannot_mean_two_things() -> None:
    with pytest.raises(HrclogError, match="found the outcome 'Done' for succeeded and for failed"):
        Outcomes(ok=["done"], failed=["Done"])


Import = Callable[..., tuple[list[str], list[tuple[str, str]]]]


@pytest.fixture
def imported(tmp_path: Path) -> Import:
    """Return what imports rows of some outcomes, and returns the outcomes in the log and what was told."""

    def run(*outcomes: object, **options: Any) -> tuple[list[str], list[tuple[str, str]]]:  # noqa: ANN401 - any option
        rows = [ROW | {"_id": {"$oid": str(at)}, "outcome": value} for at, value in enumerate(outcomes)]
        source = tmp_path / "dump.json"
        source.write_text(json.dumps([{k: v for k, v in row.items() if v != "absent"} for row in rows]))
        result = import_files(Mongo(), [source], tmp_path / "logs", **options)
        found = intervals(read_logs([tmp_path / "logs"]).events).sort("reason")
        assert result.n_executions == found.height == len(outcomes)
        assert found["end_ns"].null_count() == 0
        return found["outcome"].to_list(), [(one.code, one.message) for one in result.diagnostics]

    return run


def test_words_and_gaps_are_unknown_and_told_with_their_number(imported: Import) -> None:
    outcomes, told = imported("done", "done", None, "absent")
    assert outcomes == ["unknown"] * 4
    remedy = "say what it means (hrclog import mongo --ok, --failed or --canceled)"
    assert told == [
        (
            "unknown_outcome",
            f"found the outcome 'done' in 2 executions, expected 1 or 0; it counts as unknown: {remedy}",
        ),
        ("unknown_outcome", "found no outcome in 2 executions, expected 1 or 0; it counts as unknown"),
    ]


def test_words_are_explained_on_the_way_in(imported: Import) -> None:
    outcomes, told = imported("done", "dropped", "stopped", ok=["Done"], failed=["dropped"], canceled=["stopped"])
    assert (sorted(outcomes), told) == (["canceled", "failed", "succeeded"], [])
