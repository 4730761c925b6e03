"""SIGKILL at random moments: every event that was acknowledged is in the log, recovered or not."""

from __future__ import annotations

import os
import random
from collections.abc import Iterator
from pathlib import Path

import pytest
from killed import Left, Server, acknowledged, check_run
from sizes import many

pytestmark = [pytest.mark.slow, pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork and SIGKILL")]


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    with Server() as server:
        yield server


def _check(folder: Path) -> Left:
    """Check what a killed recorder left, before and after recovery."""
    left = check_run(folder, acknowledged(folder))
    assert (left.n_lost, left.faults) == (0, []), folder
    return left


@pytest.mark.parametrize("signals", [False, True])
@pytest.mark.parametrize(("pace_s", "longest_s"), [(0.0, 0.04), (0.003, 0.15)])
def test_kills_lose_nothing_that_was_acknowledged(
    server: Server, tmp_path: Path, pace_s: float, longest_s: float, signals: bool
) -> None:
    chance = random.Random(f"{pace_s}")
    states: set[str] = set()
    n_events = 0
    kills = many(12, fuzz=200)
    for number in range(kills):
        folder = tmp_path / str(number)
        folder.mkdir()
        after_s = chance.uniform(0.0, longest_s)
        n_first = number % 2 * 12  # every other kill comes at any time, the start of the recorder included
        server.run_and_kill("record", folder, after_s, n_first=n_first, pace_s=pace_s, count=10**6, signals=signals)
        left = _check(folder)
        states.add(left.state)
        n_events += left.n_acknowledged
    assert "run.mcap.partial" in states
    assert n_events >= 6 * kills


def test_kills_around_the_end_of_a_run_leave_its_journal_or_its_log(server: Server, tmp_path: Path) -> None:
    chance = random.Random(0)
    states: set[str] = set()
    for number in range(many(30, fuzz=600)):
        folder = tmp_path / str(number)
        folder.mkdir()
        count = chance.randrange(1, 60)
        # some kills come at any time, some around the last task, some around the end of the run
        n_first = (0, 2 * count - 1, 2 * count + number % 2)[number % 3]
        server.run_and_kill("record", folder, chance.uniform(0.0, 0.03), n_first=n_first, pace_s=0.0, count=count)
        states.add(_check(folder).state)
    assert {"run.mcap.partial", "run.mcap"} <= states


def test_kills_while_a_journal_is_closed_or_a_run_goes_on_lose_nothing(server: Server, tmp_path: Path) -> None:
    chance = random.Random(1)
    for number in range(many(12, fuzz=200)):
        folder = tmp_path / str(number)
        folder.mkdir()
        server.run_and_kill("record", folder, 0.04, pace_s=0.0, count=10**6)
        if number % 2:
            server.run_and_kill("close", folder, chance.uniform(0.0, 0.02))
        else:
            server.run_and_kill("record", folder, chance.uniform(0.0, 0.1), pace_s=0.0, count=10**6, resume=True)
        _check(folder)
