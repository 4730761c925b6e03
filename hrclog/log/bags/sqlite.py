"""Read one SQLite part of a ROS 2 bag, `.db3`, as what an MCAP file holds; the file itself is never written to."""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from mcap.records import Channel, Schema

from hrclog.errors import LogReadError, NoLogError
from hrclog.log.bags.sqlite_rows import Damage, message_rows
from hrclog.log.limits import CHANNELS, DECLARATIONS, ROW, STEPS, UNPACKED, Budget, LimitError
from hrclog.log.mcap.contents import Contents, Wanted, batch_of
from hrclog.log.mcap.records import Problem
from hrclog.wording import counted

_SIDECARS: Final = ("-wal", "-journal")
_BATCH_BYTES: Final = 1 << 22
_INT64: Final = 2**63
_SQLITE_LENGTH: Final = 10**9
_STEP: Final = 10_000  # of the database, after which they are counted

_Row = tuple[int, int, bytes]
"""(topic, time in ns, message)."""


def read_database(path: Path, wanted: Wanted, content: bytes | None, budget: Budget) -> Contents:
    """Read the messages of a part of a bag, as far as it is whole.

    Args:
        path: the file; a journal of SQLite beside it is taken into account.
        wanted: says of a channel and its schema whether its messages are needed.
        content: what the file holds, if it was compressed.
        budget: of the file.

    Raises:
        LogReadError: it cannot be opened, is no part of a bag, or declares more than its limit.
    """
    contents = Contents(finished=True, budget=budget)
    try:
        with _opened(path, content) as database:
            _limit(database, budget if content is None else Budget(len(content)))
            _declare(database, contents, path)
            _read_messages(database, contents, wanted)
    except LimitError as error:
        raise LogReadError(path, f"an SQLite file that asks for too much ({error})", "a part of a ROS 2 bag") from error
    except (sqlite3.Error, OSError, UnicodeDecodeError) as error:
        description = f"an SQLite file that cannot be read ({error})"
        raise LogReadError(path, description, "a part of a ROS 2 bag") from error
    contents.problems += _missing_pages(path, content)
    contents.unprotected = bool(contents.batches or contents.counts)
    return contents


@contextmanager
def _opened(path: Path, content: bytes | None) -> Iterator[sqlite3.Connection]:
    """Open a database for reading; one with a journal in a copy, as SQLite would write to it."""
    with tempfile.TemporaryDirectory(prefix="hrclog-") as folder:
        sidecars = [] if content is not None else [path.with_name(path.name + suffix) for suffix in _SIDECARS]
        sidecars = [sidecar for sidecar in sidecars if sidecar.is_file()]
        opened = path.absolute()
        if sidecars or content is not None:
            opened = Path(folder, "part.db3")
            if content is None:
                shutil.copyfile(path, opened)
            else:
                opened.write_bytes(content)
            for sidecar in sidecars:
                shutil.copyfile(sidecar, opened.with_name(opened.name + sidecar.name[len(path.name) :]))
        options = "" if sidecars else "?mode=ro&immutable=1"
        database = sqlite3.connect(f"file:{quote(str(opened))}{options}", uri=True)
        try:
            database.execute("PRAGMA trusted_schema = OFF")
            database.execute("PRAGMA writable_schema = ON")  # else SQLite refuses a file that breaks off as a whole
            database.text_factory = lambda text: text.decode(errors="replace")
            yield database
        finally:
            database.close()


def _limit(database: sqlite3.Connection, budget: Budget) -> None:
    """Bound what the database may cost: its tables can compute what they hold, also texts of a gigabyte."""
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, min(budget.most(ROW), _SQLITE_LENGTH))
    n_left = budget.most(STEPS) // _STEP

    def count() -> bool:
        nonlocal n_left
        n_left -= 1
        return n_left < 0

    database.set_progress_handler(count, _STEP)


def _declare(database: sqlite3.Connection, contents: Contents, path: Path) -> None:
    tables = {name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    if not {"topics", "messages"} <= tables or not {"topic_id", "timestamp", "data"} <= _columns(database, "messages"):
        raise NoLogError(path, "an SQLite file that is no part of a bag", "a log", "name a log or a bag")
    definitions: dict[str, tuple[str, str]] = {}
    if "message_definitions" in tables:
        query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        for name, encoding, text in database.execute(query):
            contents.budget.spend(DECLARATIONS)
            contents.budget.spend(UNPACKED, len(text) if isinstance(text, str | bytes) else 0)
            definitions[str(name)] = str(encoding), str(text)
    for topic_id, name, kind, encoding in database.execute("SELECT id, name, type, serialization_format FROM topics"):
        if not isinstance(topic_id, int):
            continue
        contents.budget.spend(CHANNELS)
        contents.budget.spend(UNPACKED, len(str(name)) + len(str(kind)))
        language, text = definitions.get(str(kind), ("", ""))
        contents.schemas[topic_id] = Schema(id=topic_id, name=str(kind), encoding=language, data=text.encode())
        contents.channels[topic_id] = Channel(topic_id, str(name), str(encoding), {}, topic_id)


def _columns(database: sqlite3.Connection, table: str) -> set[str]:
    return {name for (name,) in database.execute("SELECT name FROM pragma_table_info(?)", (table,))}


def _read_messages(database: sqlite3.Connection, contents: Contents, wanted: Wanted) -> None:
    ids = [channel.id for channel in contents.channels.values() if wanted(channel, contents.schemas[channel.schema_id])]
    if not ids:
        _count_messages(database, contents)
        return
    batch_rows: list[_Row] = []
    n_bytes, n_odd, n_read = 0, 0, 0
    damage = Damage()
    for topic_id, time_ns, data in message_rows(database, ids, damage):
        if not _is_message(time_ns, data):
            n_odd += 1
            continue
        try:
            contents.budget.spend(UNPACKED, len(data))
        except LimitError as error:
            text = f"{error}; the messages behind the first {counted(n_read, 'message')} of our topics were not read"
            contents.problems.append(Problem("limit_reached", 0, text))
            break
        n_read += 1
        batch_rows.append((topic_id, time_ns, data))
        n_bytes += len(data)
        if n_bytes > _BATCH_BYTES:
            contents.batches.append(batch_of(*zip(*batch_rows, strict=True)))
            batch_rows, n_bytes = [], 0
    if damage.error:
        contents.problems.append(Problem("corrupt_data", 0, damage.text, n_messages=damage.n_lost))
    if batch_rows:
        contents.batches.append(batch_of(*zip(*batch_rows, strict=True)))
    if n_odd:
        text = counted(n_odd, "row holds no message and was skipped", "rows hold no messages and were skipped")
        contents.problems.append(Problem("corrupt_data", 0, text))


def _count_messages(database: sqlite3.Connection, contents: Contents) -> None:
    """Count the messages of all topics, past pages that are damaged."""
    query = "SELECT topic_id, count(*) FROM messages GROUP BY topic_id"
    try:
        contents.counts = {int(topic_id): int(count) for topic_id, count in database.execute(query)}
    except sqlite3.DatabaseError:
        damage = Damage()
        ids = [channel.id for channel in contents.channels.values()]
        contents.counts = Counter(topic_id for topic_id, _, _ in message_rows(database, ids, damage))
        if damage.error:
            contents.problems.append(Problem("corrupt_data", 0, damage.text, n_messages=damage.n_lost))


def _is_message(time_ns: Any, data: Any) -> bool:  # noqa: ANN401 - SQLite's columns hold anything
    return isinstance(data, bytes) and isinstance(time_ns, int) and -_INT64 <= time_ns < _INT64


def _missing_pages(path: Path, content: bytes | None) -> list[Problem]:
    """Compare the length of the file with what its header says; 0 pages mean that an old SQLite wrote it."""
    if content is None:
        with path.open("rb") as stream:
            head, size = stream.read(100), path.stat().st_size
    else:
        head, size = content[:100], len(content)
    page_size, n_pages = int.from_bytes(head[16:18], "big"), int.from_bytes(head[28:32], "big")
    expected = (page_size if page_size > 1 else 1 << 16) * n_pages
    is_current = head[24:28] == head[92:96]  # else the count of pages is not that of the last change
    if size >= expected or not is_current:
        return []
    text = f"the database breaks off: {expected - size:,} of its {counted(expected, 'byte')} are missing"
    return [Problem("truncated", size, text)]
