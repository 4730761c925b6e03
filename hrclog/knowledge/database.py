"""Transactions on a knowledge base, and the errors of those that fail."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, Self

from sqlalchemy import Connection, insert, inspect, select, text
from sqlalchemy.exc import DBAPIError, SQLAlchemyError

from hrclog.errors import KnowledgeError
from hrclog.knowledge.place import WRITING, Place, make_engine, place_of
from hrclog.knowledge.tables import KNOWLEDGE_VERSION, META, METADATA

WAIT_S: Final = 10.0
"""How long to wait for another writer, in seconds."""

_LOCK: Final = 0x6872636C6F67  # "hrclog", the number of the lock that writers to one PostgreSQL database share


class Database:
    """A place with the tables of a knowledge base.

    Args:
        where: a file, sqlite:///FILE or postgresql://USER@HOST/DATABASE.
        create: make the tables where nothing is.
        wait_s: how long to wait for another writer.

    Raises:
        KnowledgeError: it cannot be reached, or is something else.
    """

    def __init__(self, where: str | Path, *, create: bool = False, wait_s: float = WAIT_S) -> None:
        self._place = place_of(where)
        self.where = self._place.shown
        self._wait_s = wait_s
        if self._place.path is not None:
            _check_file(self._place.path, create=create)
        self._engine = make_engine(self._place, wait_s)
        try:
            if not self._exists():
                self._create(create=create)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close all connections; what was written stays."""
        self._engine.dispose()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextmanager
    def reading(self) -> Iterator[Connection]:
        """Give a connection that sees one state throughout, whatever others write.

        Raises:
            KnowledgeError: the database fails.
        """
        options = {} if self._is_sqlite else {"isolation_level": "REPEATABLE READ"}
        with (
            _translate_errors(self._place),
            self._engine.connect().execution_options(**options) as connection,
            connection.begin(),
        ):
            yield connection

    @contextmanager
    def writing(self) -> Iterator[Connection]:
        """Give the one connection that may write, and commit at the end; all or nothing is written.

        Raises:
            KnowledgeError: the database fails, or another process writes for too long.
        """
        options = {WRITING: True}
        with (
            _translate_errors(self._place),
            self._engine.connect().execution_options(**options) as connection,
            connection.begin(),
        ):
            if not self._is_sqlite:
                connection.execute(text(f"SET LOCAL lock_timeout = {int(self._wait_s * 1000)}"))
                connection.execute(text(f"SELECT pg_advisory_xact_lock({_LOCK})"))
            yield connection

    @property
    def _is_sqlite(self) -> bool:
        return self._place.path is not None

    def _exists(self) -> bool:
        """Return whether this is a knowledge base; False where there is nothing.

        Raises:
            KnowledgeError: it is something else.
        """
        with self.reading() as connection:
            table_names = set(inspect(connection).get_table_names())
            if META.name in table_names:
                _check_version(self._place, connection)
                return True
        foreign_names = table_names if self._is_sqlite else table_names & set(METADATA.tables)
        if foreign_names:
            names = ", ".join(sorted(foreign_names)[:4])
            raise KnowledgeError(self.where, f"found a database of something else (tables {names})", _ANOTHER)
        return False

    def _create(self, *, create: bool) -> None:
        if not create:
            raise _missing_error(self.where)
        if self._is_sqlite:
            with _translate_errors(self._place), self._engine.connect() as connection:
                raw = connection.connection.driver_connection
                assert raw is not None  # noqa: S101 - a connection has one
                raw.execute("PRAGMA journal_mode=WAL")  # readers and a writer do not wait for each other
        with self.writing() as connection:
            if not inspect(connection).has_table(META.name):  # another process may have created it meanwhile
                METADATA.create_all(connection)
                connection.execute(insert(META).values(key="schema_version", value=KNOWLEDGE_VERSION))


_ANOTHER: Final = "choose another place for the knowledge base"


def _check_file(path: Path, *, create: bool) -> None:
    if path.is_dir():
        raise KnowledgeError(path, "found a folder, expected a file", _ANOTHER)
    if not path.exists() and not create:
        raise _missing_error(path)
    if not path.parent.is_dir():
        raise KnowledgeError(path, f"there is no folder {path.parent}", "make it, or correct the path")


def _missing_error(where: str | Path) -> KnowledgeError:
    remedy = f"correct the name, or make one with: hrclog kb update LOG... --kb {where}"
    return KnowledgeError(where, "found no knowledge base", remedy)


def _check_version(place: Place, connection: Connection) -> None:
    version = connection.execute(select(META.c.value).where(META.c.key == "schema_version")).scalar()
    if version != KNOWLEDGE_VERSION:
        mismatch = f"found a knowledge base of schema version {version}, expected {KNOWLEDGE_VERSION}"
        remedy = "use the hrclog that made it, or make a new one from the logs with hrclog kb update LOG... --kb NEW"
        raise KnowledgeError(place.shown, mismatch, remedy)


@contextmanager
def _translate_errors(place: Place) -> Iterator[None]:
    """Turn the errors of a database into errors that say what to do."""
    try:
        yield
    except DBAPIError as error:
        raise _database_error(
            place, str(error.orig).strip().splitlines()[0] if str(error.orig).strip() else "?"
        ) from error
    except (SQLAlchemyError, sqlite3.Error) as error:  # the latter of a connection that is used directly
        raise _database_error(place, str(error).splitlines()[0]) from error


_REMEDIES: Final = (
    # what a database says, what it means, what to do
    ("file is not a database", "found a file that is no SQLite database", _ANOTHER),
    ("database is locked", "another process is writing, and did not end in time", "try again when it is done"),
    ("lock timeout", "another process is writing, and did not end in time", "try again when it is done"),
    ("readonly database", "it can only be read", "fix the permissions of the file and its folder"),
    ("unable to open", "it cannot be opened", "fix the permissions of the file and its folder"),
    ("disk is full", "the disk is full", "make room"),
    ("disk I/O error", "it cannot be written or read", "make room on its disk, or see whether that is in order"),
    ("malformed", "the database is damaged", "make a new one from the logs with hrclog kb update LOG... --kb NEW"),
    ("authentication failed", "user or password are wrong", "correct them (see ~/.pgpass)"),
    ("no password supplied", "a password is needed", "give it in ~/.pgpass or PGPASSWORD"),
    ("does not exist", "there is no such database or user", "make it with createdb, or correct the name"),
    ("permission denied", "the user may not do this", "ask for the right to create and write tables"),
    ("onnection", "the server cannot be reached", "start it, or correct host and port"),
)


def _database_error(place: Place, failure: str) -> KnowledgeError:
    for pattern, meaning, remedy in _REMEDIES:
        if pattern in failure:
            return KnowledgeError(place.shown, f"{meaning} ({failure})", remedy)
    return KnowledgeError(place.shown, f"the database failed ({failure})", "see its own messages")
