"""Where a run begins and ends: one recording is one run, or a topic tells, or a pause of all agents."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from hrclog.recorders.mapping.facts import Fact, Notes, RunMark
from hrclog.recorders.mapping.meaning import Meaning
from hrclog.recorders.mapping.received import Received
from hrclog.recorders.mapping.table import Table
from hrclog.recorders.mapping.values import Value
from hrclog.units import NS_PER_S

BY: Final = ("recording", "topic", "gap")


class RunRule:
    """The table `[run]`.

    Attributes:
        by: one of `BY`.
        gap_ns: how long nobody may do anything within a run, by gaps.
        marks: what the topic means, by topic.

    Args:
        table: of the mapping file; an empty one means that a recording is a run.
    """

    def __init__(self, table: Table) -> None:
        self.by = table.choice("by", BY, BY[0])
        self.gap_ns = int(table.number("gap_s", 60.0, above=0.0) * NS_PER_S)
        if "gap_s" in table and self.by != "gap":
            table.problem('found gap_s, expected by = "gap" beside it')
        self.marks = _Marks(table) if self.by == "topic" else None


class _Marks(Meaning):
    """A topic that tells the name of the run, "" between runs; or words for its begin and end."""

    kind = "run"
    summary = "a topic that tells when a run begins and ends"

    def __init__(self, table: Table) -> None:
        super().__init__(table)
        self._name = table.value("name", Value(""))
        self._state = table.value("state", Value(""))
        self._started, self._ended = table.words("started", ("true",)), table.words("ended", ("false",))
        self._none = table.words("none", ("",))
        self._time = table.time()
        if (self._name.path is None) == (self._state.path is None):
            table.problem("found neither or both of name and state, expected a field for one of them")
        self._current = ""
        self._count = 0

    def take(self, received: Received, notes: Notes) -> Iterator[Fact]:
        """Return the begin or the end of a run."""
        at = self._time.of(received)
        name = self._name_in(received, notes)
        if name != self._current:
            self._current = name
            yield Fact(RunMark(name, at.ns), at.clock)

    def _name_in(self, received: Received, notes: Notes) -> str:
        if self._name.path is not None:
            name = self._name.of(received.content, {})
            return "" if name in self._none else name
        state = self._state.of(received.content, {})
        if state in self._ended:
            return ""
        if state not in self._started:
            notes.remark(
                "unmapped_value", f"{{}} of {received.topic}: the state {state!r} is in no list of {self.where}"
            )
        elif not self._current:
            self._count += 1
            return str(self._count)
        return self._current
