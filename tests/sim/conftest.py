"""Runs of the stepped cell, simulated once and looked at by many tests; a stage for single commands."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache

import pytest
from cells import Stage

from hrclog.sim.bullet.engine import with_policy
from hrclog.sim.cell.description import Cell
from hrclog.sim.run import Run, simulate_run
from hrclog.sim.scenario import Scenario, load_scenario

SEED = 1

BulletRuns = Callable[[str, int], Run]


@pytest.fixture(scope="session")
def paper() -> Scenario:
    """Return the paper's scenario, with its cell."""
    scenario = load_scenario("paper")
    assert scenario.cell is not None
    return scenario


@pytest.fixture(scope="session")
def bullet_runs(paper: Scenario) -> BulletRuns:
    """Return the stepped run of a policy and a number, simulated when it is first asked for."""
    pytest.importorskip("pybullet")

    @cache
    def run(policy: str, index: int) -> Run:
        return simulate_run(with_policy(paper, policy), SEED, index, engine="bullet")

    return run


@pytest.fixture
def stage() -> Iterator[Callable[..., Stage]]:
    """Return a maker of stages, see `cells.Stage`, that frees them at the end."""
    pytest.importorskip("pybullet")
    made: list[Stage] = []

    def make(cell: Cell, gap_s: float = 0.0, seed: int = 1) -> Stage:
        made.append(Stage(cell, gap_s, seed))
        return made[-1]

    yield make
    for one in made:
        one.close()
