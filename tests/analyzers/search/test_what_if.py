"""Factors that somebody supposes instead of those that were learnt."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hrclog.analyzers.search.what_if import read_overrides, read_pairs, with_overrides
from hrclog.analyzers.search.worlds import drawn_worlds, expected_world
from hrclog.errors import ScenarioError
from hrclog.knowledge.task_times import Factor, TaskTime, TaskTimes

H, R, S = ("H", "a"), ("R", "x"), ("R", "y")
COVARIANCE = np.array([[4.0, 1.0, 2.0], [1.0, 5.0, 3.0], [2.0, 3.0, 6.0]])
TIMES = TaskTimes(
    {
        H: TaskTime(*H, 1.0, 0.1, 9, (Factor(*R, 0.3, 7),), COVARIANCE),
        R: TaskTime(*R, 1.0, 0.1, 9),
        S: TaskTime(*S, 1.0, 0.1, 9),
    },
    {},
)
PAIR = {"agent": "H", "task": "a", "other_agent": "R", "other_task": "x"}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "synergies.json"


def test_factors_are_read_from_a_file(file: Path) -> None:
    file.write_text(json.dumps({"synergies": [PAIR | {"synergy": 2.5}, PAIR | {"other_task": "y", "synergy": 0.5}]}))
    assert read_overrides(file) == {(H, R): 2.5, (H, S): 0.5}


def test_pairs_are_read_from_a_file(file: Path) -> None:
    file.write_text(json.dumps({"pairs": [PAIR]}))
    assert read_pairs(file) == ((H, R),)


@pytest.mark.parametrize(
    ("entries", "told"),
    [
        ([PAIR], "synergy"),
        ([PAIR | {"synergy": 0.0}], "synergy"),
        ([PAIR | {"synergy": "fast"}], "synergy"),
        ([PAIR | {"synergy": 1.0, "why": "so"}], "why"),
        ([PAIR | {"synergy": 1.0}, PAIR | {"synergy": 2.0}], "given twice; remove one"),
        ([PAIR | {"synergy": 1.0, "other_agent": "H"}], "'H' does one task at a time; name two agents"),
        ("nonsense", "synergies"),
    ],
)
def test_a_wrong_factor_is_told_by_file_and_field(entries: Any, told: str, file: Path) -> None:  # noqa: ANN401 - JSON
    file.write_text(json.dumps({"synergies": entries}))
    with pytest.raises(ScenarioError, match=told) as caught:
        read_overrides(file)
    assert str(file) in str(caught.value)


@pytest.mark.parametrize("text", ["", "{", '{"synergies": [NaN]}', "[]"])
def test_what_is_no_such_file_is_told(text: str, file: Path) -> None:
    with pytest.raises(ScenarioError, match="cannot be read"):
        read_overrides(file)
    file.write_text(text)
    for read in (read_overrides, read_pairs):
        with pytest.raises(ScenarioError, match=r"synergies\.json"):
            read(file)


def test_a_supposed_factor_takes_the_place_of_the_one_learnt_and_is_certain() -> None:
    time = with_overrides(TIMES, {(H, R): 4.0}).times[H]
    assert time.factors == (Factor(*R, math.log(4.0), 0),)
    assert time.covariance is not None
    assert time.covariance.tolist() == [[4.0, 1.0, 0.0], [1.0, 5.0, 0.0], [0.0, 0.0, 0.0]]
    assert COVARIANCE[2, 2] == 6.0  # what was learnt stays as it is
    assert (time.mu, time.sigma, time.n) == (1.0, 0.1, 9)


def test_a_supposed_factor_that_nobody_saw_is_added() -> None:
    found = with_overrides(TIMES, {(H, S): 0.5, (R, H): 2.0}).times
    assert found[H].factors == (Factor(*R, 0.3, 7), Factor(*S, math.log(0.5), 0))
    assert found[H].covariance is not None
    assert found[H].covariance.shape == (4, 4)
    assert found[H].covariance[:3, :3].tolist() == COVARIANCE.tolist()
    assert not found[H].covariance[3].any()
    assert (found[R].factors, found[R].covariance) == ((Factor(*H, math.log(2.0), 0),), None)
    assert found[S] is TIMES.times[S]


def test_worlds_are_as_somebody_supposes() -> None:
    supposed = with_overrides(TIMES, {(H, R): 4.0, (R, H): 0.5})
    keys = [H, R]
    for world in (expected_world(supposed, keys, ("H", "R"), 1), drawn_worlds(supposed, keys, ("H", "R"), 1, 8)):
        assert world.rate[:, 0, 1] == pytest.approx(1 / 4.0)
        assert world.rate[:, 1, 0] == pytest.approx(2.0)


@pytest.mark.parametrize("pair", [(("H", "b"), R), (H, ("R", "z"))])
def test_of_tasks_that_nobody_knows_nothing_can_be_supposed(pair: tuple[tuple[str, str], tuple[str, str]]) -> None:
    with pytest.raises(ScenarioError, match="nothing is known of it; known are a by H, x by R, y by R"):
        with_overrides(TIMES, {pair: 2.0})
