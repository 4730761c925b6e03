"""The calibrated scenarios stay near the runs they were calibrated to; the script that says how near works."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest
from sizes import many

ROOT = Path(__file__).parents[2]
ROW = re.compile(r"^\| (\w+) \| (\w+) \| \S+ ± \S+ \| \S+ ± \S+ \| ([+-][\d.]+) % \|", re.MULTILINE)


def loaded(path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Return a script as a module."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, path.stem, module)  # its dataclasses look themselves up
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_mean_durations_and_makespans_are_those_of_the_real_runs(
    data_dir: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("pybullet")
    script = loaded(ROOT / "benchmarks" / "calibration.py", monkeypatch)
    halved, step = script.halved, many(3, fuzz=1)
    monkeypatch.setattr(script, "halved", lambda plans: tuple(half[::step] for half in halved(plans)))
    monkeypatch.setattr(sys, "argv", ["calibration.py", "--data", str(data_dir), "--repeats", "1", "--workers", "1"])
    script.main()
    rows = ROW.findall(capsys.readouterr().out)
    assert len(rows) == 2 * 9
    for agent, task, percent in rows:
        # one run of every third plan leaves a standard error of up to 14 % of the robot's mean durations
        assert abs(float(percent)) < (6.0 if task == "makespan" else 25.0 if agent == "robot" else 12.0), (agent, task)
