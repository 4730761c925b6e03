"""Counts agree with the words that follow them, in sentences and in what the commands print."""

from __future__ import annotations

import pytest

from hrclog.wording import agree, counted


@pytest.mark.parametrize(
    ("number", "text"), [(0, "0 runs"), (1, "1 run"), (2, "2 runs"), (12, "12 runs"), (1234, "1,234 runs")]
)
def test_a_count_is_told_with_the_form_that_it_asks_for(number: int, text: str) -> None:
    assert counted(number, "run") == text


def test_an_irregular_plural_is_given_and_a_verb_may_follow() -> None:
    assert counted(1, "entry", "entries") == "1 entry"
    assert counted(3, "entry", "entries") == "3 entries"
    assert counted(1, "run is", "runs are") == "1 run is"
    assert counted(0, "run is", "runs are") == "0 runs are"


def test_a_verb_apart_from_its_number_agrees_with_it() -> None:
    assert [agree(number, "is", "are") for number in (0, 1, 2)] == ["are", "is", "are"]
