"""A table of a mapping may be about some messages of its topics only."""

from __future__ import annotations

from typing import Any

from hrclog.recorders.mapping.fields import AbsentFieldError, word
from hrclog.recorders.mapping.table import Table


class Only:
    """The keys `only` and `is` of a table: a field, and the values for which a message counts.

    Args:
        table: of the mapping file.
    """

    def __init__(self, table: Table) -> None:
        self._path = table.path("only") if "only" in table else None
        self._words = table.words("is")
        if ("only" in table) != ("is" in table):
            table.problem('found one of only and is, expected both: only = "device", is = ["robot"]')

    def holds(self, content: Any) -> bool:  # noqa: ANN401 - a decoded message
        """Return whether a message counts."""
        if self._path is None:
            return True
        try:
            return word(self._path.of(content)) in self._words
        except AbsentFieldError:
            return False
