"""Where the tests find the shared data, a PostgreSQL server, and places for knowledge bases."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from kb_postgres import Server, binaries, private_server

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


@pytest.fixture(scope="session")
def server() -> Iterator[Server]:
    programs = binaries()
    if programs is None:
        pytest.skip("no PostgreSQL server; apt-get install postgresql")
    with private_server(programs) as running:
        yield running


@pytest.fixture
def postgres(server: Server) -> str:
    """Return the URL of an empty schema."""
    return server.new_schema()


@pytest.fixture(params=["sqlite", "postgres"])
def where(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """Return a place for a knowledge base, in each database."""
    return str(tmp_path / "kb.sqlite") if request.param == "sqlite" else str(request.getfixturevalue("postgres"))
