"""Errors say path, finding and remedy, and survive the way back from a worker process."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest

from hrclog import errors
from hrclog.errors import HrclogError

EXAMPLES: list[HrclogError] = [
    errors.LogExistsError(Path("a.mcap"), "choose another name"),
    errors.LogReadError("a.mcap", "nothing", "a log", "check the path"),
    errors.LogWriteError("a.mcap", "disk full", "free space"),
    errors.ImportDataError("a.json", "no JSON", "a dump"),
    errors.OutputError("out", "cannot be written"),
    errors.ScenarioError("a cycle"),
]


@pytest.mark.parametrize("error", EXAMPLES, ids=lambda error: type(error).__name__)
def test_an_error_is_the_same_after_pickling(error: HrclogError) -> None:
    again = pickle.loads(pickle.dumps(error))  # noqa: S301 - our own bytes
    assert type(again) is type(error)
    assert str(again) == str(error)
    assert again.__dict__ == error.__dict__


def test_every_error_has_the_one_root() -> None:
    kinds = [kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, Exception)]
    assert all(issubclass(kind, HrclogError) for kind in kinds)
