"""Read the messages in an SQLite table, past pages that are damaged: such a page costs the rows that lie in it."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from hrclog.wording import counted

_LOWEST: Final = -(2**63)
_FIRST: Final = 1  # as SQLite numbers rows
_HIGHEST: Final = 2**62
_MOST_PLACES: Final = 10_000

_TABLE: Final = "FROM messages WHERE rowid >= ?"
_ORDER: Final = "ORDER BY rowid"


@dataclass(slots=True)
class Damage:
    """What could not be read.

    Attributes:
        error: what SQLite says of the first place.
        places: first and last number of the rows that are lost together, of all topics.
        read_before: how many messages were read before the first place.
        to_the_end: whether all behind the last place is lost too, which nothing counts.
    """

    error: str = ""
    places: list[tuple[int, int]] = field(default_factory=list)
    read_before: int = 0
    to_the_end: bool = False

    @property
    def n_lost(self) -> int:
        """Return how many rows are lost at most, but for those at the end."""
        return sum(last - first + 1 for first, last in self.places)

    @property
    def text(self) -> str:
        """Say what was lost."""
        place = f"the database is damaged ({self.error}) behind its first {counted(self.read_before, 'message')}"
        lost = []
        if self.places:
            first, last = self.places[0]
            where = f", the first {first:,} to {last:,}" if last > first else f", the first {first:,}"
            n_places = counted(len(self.places), "place")
            lost.append(f"{counted(self.n_lost, 'row')} of all topics cannot be read in {n_places}{where}")
        if self.to_the_end:
            lost.append("nothing behind that can be read" if lost else "nothing behind them can be read")
        return f"{place} of our topics: {'; '.join(lost)}"


def message_rows(
    database: sqlite3.Connection, topic_ids: Sequence[int], damage: Damage
) -> Iterator[tuple[Any, Any, Any]]:
    """Yield topic, time and data of the messages of some topics, in the order of writing.

    Args:
        database: a part of a bag.
        topic_ids: of the topics.
        damage: takes what could not be read.
    """
    marks = ", ".join("?" * len(topic_ids))
    only_ours = f"SELECT rowid, topic_id, timestamp, data {_TABLE} AND topic_id IN ({marks}) {_ORDER}"
    # once a page is damaged, rows of other topics tell where; what they hold is not read
    every_row = f"SELECT rowid, topic_id, timestamp, CASE WHEN topic_id IN ({marks}) THEN data END {_TABLE} {_ORDER}"
    ours = set(topic_ids)
    n_read, begin = 0, _LOWEST
    while len(damage.places) < _MOST_PLACES:
        rows = database.execute(only_ours, (begin, *topic_ids)) if not damage.error else None
        try:
            for number, topic_id, time_ns, data in rows or database.execute(every_row, (*topic_ids, begin)):
                begin = number + 1
                if topic_id in ours:
                    n_read += 1
                    yield topic_id, time_ns, data
        except sqlite3.Error as error:
            if not damage.error:
                damage.error, damage.read_before = str(error), n_read
                begin = max(begin, _FIRST)
                continue
        else:
            return
        found = _next_readable(database, begin + 1)
        if found is None:
            break
        first = damage.places.pop()[0] if damage.places and damage.places[-1][1] == begin - 1 else begin
        damage.places.append((first, found - 1))
        begin = found
    damage.to_the_end = True


def _next_readable(database: sqlite3.Connection, begin: int) -> int | None:
    """Return the number of the first row from `begin` on that can be reached, None if none can."""
    step, low, high = 1, begin - 1, begin
    while (number := _row_from(database, high)) is None:
        if high > _HIGHEST:
            return None
        low, high, step = high, high + step, 2 * step
    while high - low > 1:
        middle = (low + high) // 2
        nearer = _row_from(database, middle)
        low, high, number = (middle, high, number) if nearer is None else (low, middle, nearer)
    return number


def _row_from(database: sqlite3.Connection, begin: int) -> int | None:
    """Return the number of the first row from `begin` on, None if it cannot be reached or there is none."""
    try:
        row = database.execute(f"SELECT rowid, topic_id {_TABLE} {_ORDER} LIMIT 1", (begin,)).fetchone()
    except sqlite3.Error:
        return None
    return None if row is None else int(row[0])
