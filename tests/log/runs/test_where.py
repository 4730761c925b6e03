"""Runs are chosen by their tags."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from hrclog.errors import HrclogError
from hrclog.log.runs.where import conditions, matching_runs

KEYS = ("a", "b")
VALUES = ("x", "y", "z")
TAGS = st.lists(st.dictionaries(st.sampled_from(KEYS), st.sampled_from(VALUES)), min_size=1, max_size=8).map(
    lambda runs: {f"r{number}": tags for number, tags in enumerate(runs)}
)
TEXTS = st.lists(
    st.builds("{}{}{}".format, st.sampled_from(KEYS), st.sampled_from(("=", "!=")), st.sampled_from(VALUES))
)


def chosen(tags: dict[str, dict[str, str]], texts: Sequence[str]) -> set[str]:
    try:
        return set(matching_runs(tags, tags, conditions(texts)))
    except HrclogError:
        return set()


@given(TAGS, TEXTS)
def test_runs_are_those_that_the_words_mean(tags: dict[str, dict[str, str]], texts: list[str]) -> None:
    assume(all(any(text[0] in of_run for of_run in tags.values()) for text in texts))
    equal = {(text[0], text[2:]) for text in texts if "!" not in text}
    unequal = {(text[0], text[3:]) for text in texts if "!" in text}
    expected = {
        run
        for run, of_run in tags.items()
        if not unequal & set(of_run.items()) and all((key, of_run.get(key)) in equal for key, _ in equal)
    }
    assert chosen(tags, texts) == expected


@given(TAGS, TEXTS, st.randoms(use_true_random=False))
def test_the_order_of_conditions_does_not_matter(
    tags: dict[str, dict[str, str]], texts: list[str], random: Random
) -> None:
    mixed = list(texts)
    random.shuffle(mixed)
    assert chosen(tags, texts) == chosen(tags, mixed + mixed)


@given(TAGS, st.sampled_from(KEYS), st.sampled_from(VALUES))
def test_a_value_and_its_negation_divide_the_runs(tags: dict[str, dict[str, str]], key: str, value: str) -> None:
    assume(any(key in of_run for of_run in tags.values()))
    equal, unequal = chosen(tags, [f"{key}={value}"]), chosen(tags, [f"{key}!={value}"])
    assert equal | unequal == set(tags)
    assert not equal & unequal


def test_conditions_are_texts_or_values_by_key() -> None:
    assert conditions("a=x") == conditions(["a=x"]) == conditions({"a": "x"})
    assert conditions({"a": ["x", "y"], "b": 3}) == conditions(["a=x", "a=y", "b=3"])
    assert conditions("a=x=y")[0].value == "x=y"


@pytest.mark.parametrize(
    "where", ["a", "=x", "!=x", ["a=x", "b"], [5], 5, {"a": None}, {"a": []}, {"a": b"x"}, {"a": {"x": 1}}]
)
def test_what_is_no_condition_is_refused(where: object) -> None:
    with pytest.raises(HrclogError, match=r"expected|tag"):
        conditions(where)  # type: ignore[arg-type]  # a user may give anything


def test_an_error_says_which_keys_and_values_there_are() -> None:
    tags = {"1": {"a": "x"}, "2": {"a": "y"}, "3": {}}
    with pytest.raises(HrclogError, match=r"no run has a tag 'c', expected one of 'a'"):
        matching_runs(tags, tags, conditions("c!=x"))
    with pytest.raises(HrclogError, match=r"none of 3 runs is so; a is not set \(1 run\), x \(1 run\), y \(1 run\)"):
        matching_runs(tags, tags, conditions("a=z"))
    with pytest.raises(HrclogError, match="these runs have no tags"):
        matching_runs(["1"], {}, conditions("a=z"))
