"""Where the tests find the authors' runs and the MCAP conformance cases."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile(
    "hrclog",
    deadline=None,  # a busy machine is no failure
    suppress_health_check=[HealthCheck.function_scoped_fixture],  # examples may share a folder
)
settings.load_profile("hrclog")

BESIDE = Path(__file__).parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Return the folder of the shared data: HRCLOG_DATA, or ../shared/data beside the repository."""
    folder = Path(os.environ.get("HRCLOG_DATA", BESIDE))
    if not folder.is_dir():
        pytest.skip(f"no shared data at {folder}; set HRCLOG_DATA to its folder")
    return folder
