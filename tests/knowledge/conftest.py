"""A PostgreSQL server for the session, and places for knowledge bases in every database."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from kb_postgres import Server, binaries, private_server


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
