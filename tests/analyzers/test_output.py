"""Names of the recordings: whole characters, short enough for a file system, one a run, whatever the order."""

from __future__ import annotations

import random
import unicodedata
from itertools import pairwise

import polars as pl
from hypothesis import given
from hypothesis import strategies as st

from hrclog.analyzers.output import drawn_runs, recording_names

NAME_MAX = 255
"""Bytes of a file's name that Linux, macOS and Windows take."""

IDS = st.sampled_from(["1", "2", "3", "4"]) | st.text(st.sampled_from("ab/"), min_size=40, max_size=42)
NAMES = (
    st.sampled_from(["a", "A", "a-1", "a/1", "", "..", "\uac00", "\u1100\u1161", "計" * 100, "計" * 101]) | st.text()
)


def names_of(*runs: tuple[str, str]) -> dict[str, str]:
    return recording_names(pl.DataFrame(runs, {"run_id": pl.String, "name": pl.String}, orient="row"))


def folded(name: str) -> str:
    return unicodedata.normalize("NFC", name.casefold())


def assert_apart(names: dict[str, str]) -> None:
    assert len({folded(name) for name in names.values()}) == len(names)


def test_a_run_alone_with_its_name_keeps_it() -> None:
    assert names_of(("1", "first run"), ("2", "../b")) == {"1": "first_run.rrd", "2": "_b.rrd"}


def test_a_long_name_is_cut_to_bytes_and_at_a_character() -> None:
    assert names_of(("1", "計" * 100)) == {"1": "計" * 33 + ".rrd"}


def test_a_name_that_another_would_get_for_its_id_is_not_given_twice() -> None:
    assert_apart(names_of(("1", "a"), ("2", "a"), ("3", "a-1")))
    taken = names_of(("1", "a"), ("2", "a"))["1"].removesuffix(".rrd")
    assert_apart(names_of(("1", "a"), ("2", "a"), ("3", taken.upper())))


def test_ids_that_begin_alike_are_told_apart() -> None:
    assert_apart(names_of(("x" * 40 + "1", "a"), ("x" * 40 + "2", "a")))


def test_names_that_differ_only_in_case_or_composition_are_told_apart() -> None:
    assert_apart(names_of(("1", "Run"), ("2", "run"), ("3", "\uac00"), ("4", "\u1100\u1161")))


@given(st.dictionaries(IDS, NAMES, max_size=6), st.randoms(use_true_random=False))
def test_names_are_different_short_and_the_same_in_every_order(runs: dict[str, str], chance: random.Random) -> None:
    names = names_of(*runs.items())
    assert names.keys() == runs.keys()
    assert_apart(names)
    for name in names.values():
        assert len(name.encode()) <= NAME_MAX
        assert "/" not in name
        assert not name.startswith(".")
    shuffled = list(runs.items())
    chance.shuffle(shuffled)
    assert names_of(*shuffled) == names


@given(st.integers(0, 40), st.integers(1, 12))
def test_the_runs_that_are_drawn_are_evenly_spread_and_hold_both_ends(count: int, most: int) -> None:
    ids = [f"r{index}" for index in range(count)]
    drawn = drawn_runs(pl.DataFrame({"run_id": ids}, {"run_id": pl.String}), most)
    assert len(drawn) == min(count, most)
    assert drawn == sorted(set(drawn), key=ids.index)
    if count > most > 1:
        assert (drawn[0], drawn[-1]) == (ids[0], ids[-1])
        steps = [ids.index(after) - ids.index(before) for before, after in pairwise(drawn)]
        assert max(steps) - min(steps) <= 1
    assert drawn_runs(pl.DataFrame({"run_id": ids}, {"run_id": pl.String}), None) == ids
