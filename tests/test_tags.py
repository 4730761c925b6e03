"""Tags: how they are written, and what is none."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hrclog.errors import InvalidEventError
from hrclog.tags import checked_tags, parse_tags

KEYS = st.text("abcXYZ0129_.- é", min_size=1, max_size=20).map(str.strip).filter(bool)
VALUES = st.text(st.characters(exclude_categories=["Cs"]), min_size=1).map(str.strip).filter(bool)


@given(st.dictionaries(KEYS, VALUES))
def test_tags_come_back_from_their_texts(tags: dict[str, str]) -> None:
    assert parse_tags(f"{key}={value}" for key, value in tags.items()) == tags
    assert checked_tags(tags) == tags


@given(st.dictionaries(KEYS, st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False)))
def test_numbers_and_truth_values_are_written_as_json_does(tags: dict[str, float]) -> None:
    assert {key: json.loads(text) for key, text in checked_tags(tags).items()} == tags


@pytest.mark.parametrize(
    "text", ["", "key", "=value", " =value", "a!=b", "a\nb=c", f"{'k' * 81}=v", "\ud800=1", "k=\ud800"]
)
def test_a_text_of_another_form_is_refused(text: str) -> None:
    with pytest.raises(InvalidEventError):
        checked_tags(parse_tags([text]))


def test_integers_of_numpy_are_integers() -> None:
    assert checked_tags({"trial": np.int64(3)}) == {"trial": "3"}


def test_a_key_has_one_value() -> None:
    assert parse_tags(["a=1", "a=1"]) == {"a": "1"}
    with pytest.raises(InvalidEventError, match="two values of 'a'"):
        parse_tags(["a=1", "a=2"])


@pytest.mark.parametrize(
    "tags", ["a=b", ["a"], 5, {"a": None}, {"a": ""}, {"a": [1]}, {5: "a"}, {"a": float("nan")}, {"a": 1, "a ": 2}]
)
def test_what_is_no_mapping_of_texts_and_numbers_is_refused(tags: object) -> None:
    with pytest.raises(InvalidEventError, match="tag"):
        checked_tags(tags)
