"""Names that a reader takes for one are told, and no others."""

from __future__ import annotations

import unicodedata

import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hrclog.analyzers.projections.lints.similar_names import folded, similar_names, visible

TEXT = st.text(st.characters(exclude_categories=["Cs"]), min_size=1)
INVISIBLE = ["\u200b", "\u00ad", "\u2060", "\ufeff", "\u200d", "\u3164", "\ufe0f", "\u034f", "\x07", "\u202e"]


def frame(*names: tuple[str, str]) -> pl.DataFrame:
    rows = [(agent, task, "run.mcap") for agent, task in names]
    return pl.DataFrame(rows, schema=["agent", "task", "path"], orient="row")


@given(TEXT, st.data())
def test_what_is_easily_overlooked_does_not_matter(name: str, data: st.DataObject) -> None:
    at = data.draw(st.integers(0, len(name)))
    addition = data.draw(st.sampled_from([" ", "\u00a0", "\u3000", "\t", *INVISIBLE]))
    assert folded(name[:at] + addition) == folded(name[:at])
    for form in ("NFC", "NFD"):
        assert folded(unicodedata.normalize(form, name)) == folded(name)
    if "İ" not in name:  # whose small form in ASCII has a mark of its own
        assert folded(name.casefold()) == folded(name)


@given(st.lists(st.text("abcdefgh_0123456789", min_size=1), unique=True))
def test_names_that_are_told_apart_are_no_finding(names: list[str]) -> None:
    assert similar_names(frame(*(("robot", name) for name in names))) == []


@given(st.sets(TEXT, min_size=2, max_size=6))
def test_names_that_differ_look_different_when_they_are_told(names: set[str]) -> None:
    assert len({visible(name) for name in names}) == len(names)
    assert all(visible(name).isprintable() for name in names)


@pytest.mark.parametrize(
    ("first", "second", "shown"),
    [
        ("pick", "Pick", "'Pick' (1 execution), 'pick' (2 executions)"),
        ("pick", "pick ", "'pick' (2 executions), 'pick ' (1 execution)"),
        ("pick", "pi\u200bck", "'pick' (2 executions), 'pi\\u200bck' (1 execution)"),
        ("p\u00edck", "pi\u0301ck", "'pi\\u0301ck' (1 execution), 'p\u00edck' (2 executions)"),
        ("計測", "計\u3164測", "'計\\u3164測' (1 execution), '計測' (2 executions)"),
    ],
)
def test_a_group_is_told_with_its_names_made_visible_and_counted(first: str, second: str, shown: str) -> None:
    [told] = similar_names(frame(("robot", first), ("human", first), ("robot", second), ("robot", "place")))
    assert (told.code, told.path) == ("similar_names", "run.mcap")
    order = "2 names of tasks differ only in case, spaces, composition or invisible characters: "
    assert told.message == f"{order}{shown}; are they one task?"


def test_agents_without_an_execution_count_too() -> None:
    [told] = similar_names(frame(("robot", "pick")), ["robot", "Robot", "human"])
    assert "2 names of agents" in told.message
    assert "'Robot' (0 executions), 'robot' (1 execution)" in told.message


def test_of_a_large_group_the_first_names_are_listed() -> None:
    [told] = similar_names(frame(*(("robot", "pick" + " " * count) for count in range(20))))
    assert told.message.startswith("20 names of tasks")
    assert "and 12 more" in told.message
