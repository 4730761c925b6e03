"""The base class of what topics may mean; `meanings` lists them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import ClassVar

from hrclog.recorders.mapping.facts import Captures, Fact, Notes
from hrclog.recorders.mapping.received import Received
from hrclog.recorders.mapping.table import Table


class Meaning(ABC):
    """What the topics of one table of a mapping file mean. It remembers what came before, so each source has its own.

    Attributes:
        kind: the name of its tables: `[[action]]`.
        summary: one line for lists.
        topic: the usual topic, None where the table must name it.
        definition: of the messages' type, or the goal of an action, for recordings that hold none; "" for none.

    Args:
        table: of the mapping file; asks for the keys that it knows.
    """

    kind: ClassVar[str]
    summary: ClassVar[str]
    topic: ClassVar[str | None] = None

    def __init__(self, table: Table) -> None:
        self.where = table.where
        self.pattern = table.topic(self.topic)
        self.is_optional = table.flag("optional")
        self.definition = table.text("definition", "")

    def wants(self, topic: str, type_name: str) -> bool:  # noqa: ARG002 - for those that look at it
        """Return whether messages of a topic are needed."""
        return self.pattern.captures(topic) is not None

    @abstractmethod
    def take(self, received: Received, notes: Notes) -> Iterable[Fact]:
        """Return what a message says.

        Args:
            received: a message of a topic that it wants, in order of log time.
            notes: takes what is to be told.

        Raises:
            UnknownFieldError: the mapping names a field that messages of this type do not have.
            ValueError: this message cannot be used; says why.
        """

    def finish(self, notes: Notes) -> Iterable[Fact]:  # noqa: ARG002 - for those that need it
        """Return what is known when no further message comes.

        Args:
            notes: takes what is to be told.
        """
        return ()

    def _captures(self, received: Received) -> Captures:
        return self.pattern.captures(received.topic) or {}
