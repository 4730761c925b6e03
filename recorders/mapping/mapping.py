"""The mapping file: TOML, one table for each thing that topics mean, and one for where runs begin."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping as Dict
from pathlib import Path
from typing import Any, Final

from hrclog.errors import MappingError
from hrclog.recorders.mapping.meaning import Meaning
from hrclog.recorders.mapping.meanings import MEANINGS
from hrclog.recorders.mapping.runs import RunRule
from hrclog.recorders.mapping.safety import Safety
from hrclog.recorders.mapping.table import Table

_RUN: Final = "run"
_MOST_BYTES: Final = 1 << 20


class Mapping:
    """What the topics of a cell mean.

    Args:
        path: the file that says so, for messages.
        content: what it holds.

    Raises:
        MappingError: it says something that has no meaning; lists all of that.
    """

    def __init__(self, path: Path, content: Dict[str, Any]) -> None:
        self.path = path
        self._content = content
        self.meanings()

    def meanings(self) -> tuple[list[Meaning], RunRule]:
        """Return the meanings in the order of the file, with nothing to remember yet, and what a run is."""
        problems: list[str] = []
        meanings: list[Meaning] = []
        for kind, tables in self._content.items():
            if kind == _RUN:
                continue
            if kind not in MEANINGS:
                problems.append(f"found the table {kind!r}, expected one of {', '.join((*MEANINGS, _RUN))}")
            elif not isinstance(tables, list) or not all(isinstance(table, Dict) for table in tables):
                problems.append(f"found {kind!r}, expected it in double brackets: [[{kind}]]")
            else:
                meanings += [self._meaning(kind, number, table, problems) for number, table in enumerate(tables, 1)]
        rule = self._run_rule(problems)
        if not meanings and not problems:
            problems.append(f"found no table, expected at least one of {', '.join(MEANINGS)}")
        if problems:
            raise MappingError(self.path, problems)
        shared: dict[str, tuple[str, float | None]] = {}
        for meaning in meanings:
            if isinstance(meaning, Safety):
                meaning.states = shared
        return [*meanings, *([rule.marks] if rule.marks else [])], rule

    @staticmethod
    def _meaning(kind: str, number: int, content: Dict[str, Any], problems: list[str]) -> Meaning:
        table = Table(f"{kind}[{number}]", content, problems)
        meaning = MEANINGS[kind](table)
        table.close()
        return meaning

    def _run_rule(self, problems: list[str]) -> RunRule:
        content = self._content.get(_RUN, {})
        if not isinstance(content, Dict):
            problems.append("found 'run' in double brackets, expected [run]")
            content = {}
        table = Table(_RUN, content, problems)
        rule = RunRule(table)
        table.close()
        return rule


def read_mapping(path: Path) -> Mapping:
    """Read a mapping file.

    Raises:
        MappingError: it cannot be read, or says something that has no meaning.
    """
    try:
        with path.open("rb") as stream:
            text = stream.read(_MOST_BYTES + 1)
        if len(text) > _MOST_BYTES:
            raise MappingError(path, [f"found more than {_MOST_BYTES:,} bytes, expected a mapping"])
        return Mapping(path, tomllib.loads(text.decode()))
    except OSError as error:
        reason = f"found a file that cannot be opened ({error.strerror}), expected a mapping"
        raise MappingError(path, [f"{reason}; `hrclog import bag BAG --suggest` writes a first one"]) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise MappingError(path, [f"found text that is no TOML ({error}), expected a mapping"]) from error
