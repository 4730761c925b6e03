"""The authors' runs as intervals."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import polars as pl
import pytest

from hrclog.analyzers.projections.intervals import rebuild
from hrclog.log.reader import read_logs
from hrclog.recorders.importers.mongo import import_mongo


@dataclass(frozen=True)
class Runs:
    """Imported runs: their events, and the executions rebuilt from them."""

    events: pl.DataFrame
    intervals: pl.DataFrame


@pytest.fixture(scope="session")
def offline(data_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Runs:
    """Return the 51 offline runs."""
    return _imported(data_dir / "safety_areas" / "task_results.json", tmp_path_factory.mktemp("offline"))


@pytest.fixture(scope="session")
def online(data_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Runs:
    """Return the 200 online runs."""
    return _imported(data_dir / "safety_areas" / "task_results_online.json", tmp_path_factory.mktemp("online"))


def _imported(source: Path, folder: Path) -> Runs:
    import_mongo([source], folder)
    logs = read_logs([folder])
    executions, diagnostics = rebuild(logs.events)
    assert not [*logs.diagnostics, *diagnostics]
    return Runs(logs.events, executions)
