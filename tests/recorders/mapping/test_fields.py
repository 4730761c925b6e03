"""Paths into messages lead where they say, and say what is there where they do not."""

from __future__ import annotations

from typing import Any

import pytest
import ros_bags as bags
from hypothesis import given
from hypothesis import strategies as st

from hrclog.recorders.mapping.fields import AbsentFieldError, FieldPath, UnknownFieldError, stamp_ns, uuid_bytes, word

NAMES = st.from_regex(r"[a-z_][a-z0-9_]{0,5}", fullmatch=True)


@given(st.lists(NAMES | st.integers(0, 3), min_size=1, max_size=6), st.integers() | st.text())
def test_a_path_leads_to_the_value_that_stands_there(steps: list[str | int], value: int | str) -> None:
    steps = ["root", *steps]
    content: Any = value
    for step in reversed(steps):
        content = {step: content} if isinstance(step, str) else [None] * step + [content]
    path = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in steps).removeprefix(".")
    assert FieldPath(path).of(content) == value


@pytest.mark.parametrize("text", ["", ".", "a.", "a..b", "[0]", "a[", "a[x]", "a b", "0a", "a.[0]", "a[0]b", "é"])
def test_what_is_no_path_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="expected a field such as"):
        FieldPath(text)


def test_a_field_that_a_type_does_not_have_lists_those_that_it_has() -> None:
    message = bags.made(bags.ROS2, "std_msgs/msg/Header", stamp=bags.stamp(5), frame_id="x")
    with pytest.raises(UnknownFieldError, match=r"no field 'sek' of 'stamp\.sek'; it has sec, nanosec$"):
        FieldPath("stamp.sek").of(message)
    with pytest.raises(UnknownFieldError, match="no message, but str"):
        FieldPath("frame_id.data").of(message)
    with pytest.raises(UnknownFieldError, match="no list"):
        FieldPath("stamp[0]").of(message)


def test_what_one_message_lacks_is_no_fault_of_the_mapping() -> None:
    with pytest.raises(AbsentFieldError, match="the list has 1 element"):
        FieldPath("a[1]").of({"a": [7]})
    with pytest.raises(AbsentFieldError, match="it has a"):
        FieldPath("b").of({"a": 1})


@given(st.integers(0, 2**62))
def test_stamps_are_exact_in_the_words_of_ros_1_and_2(ns: int) -> None:
    assert stamp_ns({"sec": ns // 10**9, "nanosec": ns % 10**9}) == ns
    assert stamp_ns({"secs": ns // 10**9, "nsecs": ns % 10**9}) == ns
    assert stamp_ns({"a": 1}) is None


@given(st.binary(min_size=16, max_size=16))
def test_a_uuid_is_its_bytes(raw: bytes) -> None:
    assert uuid_bytes({"uuid": list(raw)}) == uuid_bytes(raw) == raw
    assert word({"uuid": list(raw)}) == raw.hex()


@pytest.mark.parametrize(("value", "expected"), [(True, "true"), (3, "3"), (3.0, "3"), (2.5, "2.5"), (" a ", "a")])
def test_values_are_words_as_a_mapping_writes_them(value: Any, expected: str) -> None:  # noqa: ANN401 - any value
    assert word(value) == expected
