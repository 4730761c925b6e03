"""Where a knowledge base is, and how to connect to it."""

from __future__ import annotations

import sqlite3
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from sqlalchemy import QueuePool, create_engine, event, make_url
from sqlalchemy.exc import ArgumentError

from hrclog.errors import KnowledgeError

if TYPE_CHECKING:
    from sqlalchemy import URL, Connection, Engine

WRITING: Final = "hrclog_writing"
"""Execution option of a connection that is to write."""

_SECONDS_TO_CONNECT: Final = 5
_FORMS: Final = "expected a file (kb.sqlite), sqlite:///FILE or postgresql://USER@HOST/DATABASE"


@dataclass(frozen=True, slots=True)
class Place:
    """A file, or a database of a server; `shown` hides the password."""

    shown: str
    path: Path | None = None
    url: URL | None = None


def place_of(where: str | Path) -> Place:
    """Return the place that a path or URL names.

    Raises:
        KnowledgeError: it is none that a knowledge base can be in.
    """
    text = str(where)
    if "://" not in text:
        return Place(text, path=Path(where))
    try:
        url = make_url(text)
    except (ArgumentError, ValueError) as error:
        scheme = text.partition("://")[0]
        raise KnowledgeError(f"{scheme}://...", "not a database URL", _FORMS) from error
    kind = url.drivername.partition("+")[0]
    shown = url.render_as_string(hide_password=True)
    if kind == "sqlite" and url.database and not url.query:
        return Place(url.database, path=Path(url.database))
    if kind in ("postgresql", "postgres") and url.database:
        return Place(shown, url=url.set(drivername="postgresql+psycopg"))
    if kind.startswith("mongodb"):
        reason = "MongoDB can only be written to"
        raise KnowledgeError(shown, reason, "use SQLite or PostgreSQL, and send copies with hrclog kb export --to")
    raise KnowledgeError(shown, f"found {kind!r} or no name of a database", _FORMS)


def shown(where: str) -> str:
    """Return what a user gave as a place, without the password."""
    try:
        return place_of(where).shown
    except KnowledgeError as error:
        return error.where


def make_engine(place: Place, wait_s: float) -> Engine:
    """Return the engine of a place; nothing is connected yet.

    Args:
        place: where.
        wait_s: how long to wait for another writer.

    Raises:
        KnowledgeError: a package is missing.
    """
    if place.path is not None:
        return _sqlite_engine(place.path, wait_s)
    assert place.url is not None  # noqa: S101 - a place is either
    try:
        connect_args = {} if "connect_timeout" in place.url.query else {"connect_timeout": _SECONDS_TO_CONNECT}
        return create_engine(place.url, connect_args=connect_args, pool_pre_ping=True)
    except ModuleNotFoundError as error:
        raise KnowledgeError(
            place.shown, f"the package {error.name} is missing", "pip install 'hrclog[postgres]'"
        ) from error


def _sqlite_engine(path: Path, wait_s: float) -> Engine:
    engine = create_engine("sqlite://", creator=lambda: _connect(path, wait_s), poolclass=QueuePool)

    @event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:
        # a writer that first reads could not become one once another has written
        writing = connection.get_execution_options().get(WRITING)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if writing else "BEGIN")

    return engine


def _connect(path: Path, wait_s: float) -> sqlite3.Connection:
    connection = sqlite3.connect(path, timeout=wait_s, isolation_level=None, check_same_thread=False)
    try:
        connection.execute("PRAGMA synchronous=NORMAL")  # a crash of the machine may lose runs, whose logs are there
        connection.execute("SELECT 1 FROM sqlite_master").fetchone()
    except sqlite3.OperationalError:
        connection.close()
        if not path.is_file() or _size(path.with_name(f"{path.name}-wal")):
            raise
        # a folder that cannot be written has no place for the files that readers share with writers
        readable = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
        connection = sqlite3.connect(readable, uri=True, isolation_level=None, check_same_thread=False)
    except sqlite3.Error:
        connection.close()
        raise
    return connection


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0
