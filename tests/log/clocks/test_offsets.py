"""Offsets of clocks as texts."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hrclog.log.clocks.offsets import checked_offset, offset_text, parse_offset


@given(st.integers(-(2**61), 2**61))
def test_what_is_printed_is_read_back_exactly(offset_ns: int) -> None:
    assert parse_offset(offset_text(offset_ns)) == offset_ns


@pytest.mark.parametrize(
    ("text", "offset_ns"),
    [
        ("3600s", 3600 * 10**9),
        ("+1h", 3600 * 10**9),
        ("-250ms", -250 * 10**6),
        ("1.5min", 90 * 10**9),
        ("+.5 s", 5 * 10**8),
        ("19d", 19 * 86_400 * 10**9),
        ("7us", 7000),
        ("-1ns", -1),
    ],
)
def test_the_units_that_people_write(text: str, offset_ns: int) -> None:
    assert parse_offset(text) == offset_ns


@pytest.mark.parametrize("text", ["", "3600", "s", "1 year", "++1s", "1e3s", "1s2", "nan s", "inf s", "٣s"])
def test_anything_else_is_an_error_that_says_what_is_expected(text: str) -> None:
    with pytest.raises(ValueError, match="expected a number and one of ns, us"):
        parse_offset(text)


def test_an_offset_of_centuries_is_an_error() -> None:
    with pytest.raises(ValueError, match="less than 73 years"):
        parse_offset("40000d")


@pytest.mark.parametrize("offset", ["+3600s", 3600 * 10**9, np.int64(3600 * 10**9)])
def test_an_offset_may_be_a_number_or_a_text(offset: object) -> None:
    assert checked_offset(offset) == 3600 * 10**9


@pytest.mark.parametrize("offset", [None, True, 1.5, 2**62, "soon", b"+1h"])
def test_what_is_no_offset_is_an_error_that_shows_it(offset: object) -> None:
    with pytest.raises(ValueError, match="expected") as error:
        checked_offset(offset)
    assert repr(offset) in str(error.value)
