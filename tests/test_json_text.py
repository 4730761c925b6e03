"""JSON of others: too large and too deep is an error that says so, and all else is what it was."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hrclog.analyzers.output import JSON_NAME
from hrclog.cli import main
from hrclog.errors import HrclogError
from hrclog.json_text import DEEPEST, EVENT_JSON, JsonLimitError, JsonLimits, parse_json, read_json_file
from hrclog.planning.plan import read_plan
from hrclog.scene import parse_scene
from hrclog.sim.scenario import load_scenario
from hrclog.sim.truth import read_truth

ROOT = Path(__file__).parents[1]
DEEP = "[" * 200_000 + "]" * 200_000
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner, max_size=4),
    max_leaves=30,
)


@given(VALUES)
def test_what_is_within_the_limits_is_read_as_ever(value: object) -> None:
    text = json.dumps(value)
    assert parse_json(text) == parse_json(text.encode()) == value


@given(st.integers(0, 3 * DEEPEST), st.sampled_from(["list", "object"]))
def test_values_may_lie_a_hundred_deep_within_each_other(depth: int, kind: str) -> None:
    opens, closes = ("[", "]") if kind == "list" else ('{"a":', "}")
    text = opens * depth + "0" + closes * depth
    if depth <= DEEPEST:
        parse_json(text)
    else:
        with pytest.raises(JsonLimitError, match=f"within each other, expected at most {DEEPEST}"):
            parse_json(text)


def test_brackets_in_texts_are_not_depth() -> None:
    assert parse_json(json.dumps({"a": "[" * 1000})) == {"a": "[" * 1000}


def test_too_many_bytes_or_values_are_refused_before_they_are_read(tmp_path: Path) -> None:
    with pytest.raises(JsonLimitError, match="8,388,611 bytes of JSON, expected at most 8,388,608"):
        parse_json(json.dumps("a" * (EVENT_JSON.n_bytes + 1)))
    with pytest.raises(JsonLimitError, match="11 values of JSON, expected at most 10"):
        parse_json(json.dumps([0] * 11), JsonLimits(100, 10))
    path = tmp_path / "a.json"
    path.write_text("[1, 2, 3]")
    with pytest.raises(JsonLimitError, match="9 bytes of JSON, expected at most 8"):
        read_json_file(path, JsonLimits(8, 10))


@pytest.mark.parametrize("read", [read_plan, load_scenario, read_truth])
def test_files_that_are_too_deep_are_typed_errors(tmp_path: Path, read: Callable[[Path], Any]) -> None:
    path = tmp_path / "deep.json"
    path.write_text(DEEP)
    with pytest.raises(HrclogError, match="within each other"):
        read(path)


def test_a_scene_that_is_too_deep_is_left_out() -> None:
    assert "within each other" in parse_scene(DEEP)[1][0]


def test_an_old_result_that_is_too_deep_is_replaced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / JSON_NAME).write_text(DEEP)
    assert main(["analyze", str(ROOT / "sample_logs/single.mcap"), "-o", str(tmp_path)]) == 0
    assert json.loads((tmp_path / JSON_NAME).read_text())["runs"]
    capsys.readouterr()
