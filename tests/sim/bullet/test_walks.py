"""In the cells that come with hrclog nobody walks through a table."""

from __future__ import annotations

import numpy as np
import pytest
from sizes import many

from hrclog.log.messages.encode import JointSignal
from hrclog.sim.bullet.engine import cell_of
from hrclog.sim.run import simulate_run
from hrclog.sim.scenario import load_scenario, scenario_names

LEGS_M = 0.1
"""Half the width of the legs, and less than how far a standing person keeps from a table."""


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in scenario_names() if load_scenario(name).cell is not None])
def test_the_human_walks_beside_the_fixtures(name: str) -> None:
    pytest.importorskip("pybullet")
    scenario = load_scenario(name)
    cell = cell_of(scenario)
    for index in range(many(2, fuzz=20)):
        run = simulate_run(scenario, 1, index, engine="bullet")
        feet = np.array(
            [
                signal.positions[:2]
                for signal in run.signals
                if isinstance(signal, JointSignal) and signal.agent == cell.human.agent
            ]
        )
        for box in cell.fixtures:
            centre, half = np.array(box.position[:2]), np.array(box.size[:2]) / 2
            beside = np.abs(feet - centre) - half
            assert (beside.max(axis=1) > LEGS_M).all(), (index, box.name)
