"""The errors a user can cause, one root."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final


class HrclogError(Exception):
    """Root of every error that hrclog raises on purpose."""

    def __reduce__(self) -> tuple[Any, ...]:
        # worker processes pickle errors; constructors take facts, but `args` holds the finished text
        return _restore, (type(self), self.args, self.__dict__)


def _restore(kind: type[HrclogError], args: tuple[object, ...], facts: dict[str, Any]) -> HrclogError:
    error = kind.__new__(kind)
    error.args = args
    error.__dict__.update(facts)
    return error


class LogExistsError(HrclogError):
    """A log would have been overwritten."""

    def __init__(self, path: Path, remedy: str) -> None:
        self.path = path
        super().__init__(f"{path}: exists already, not overwriting it; {remedy}")


class LogReadError(HrclogError):
    """A file cannot be read as an event log at all."""

    def __init__(self, path: Path | str, found: str, expected: str, remedy: str = "") -> None:
        self.path = Path(path)
        self.reason = f"found {found}, expected {expected}{'; ' if remedy else ''}{remedy}"
        super().__init__(f"{path}: {self.reason}")


class NoLogError(LogReadError):
    """A file is of another kind, or a folder holds no log."""


class LogWriteError(HrclogError):
    """An event could not be written."""

    def __init__(self, path: Path | str, reason: str, remedy: str) -> None:
        self.path = Path(path)
        super().__init__(f"{path}: {reason}; {remedy}")


class IllegalEventError(HrclogError):
    """An event would break the state machine of its execution, so it was not recorded."""


class InvalidEventError(HrclogError):
    """An event's fields are not of the form the vocabulary asks for."""


class ImportDataError(HrclogError):
    """A foreign file cannot be turned into logs."""

    def __init__(self, path: Path | str, found: str, expected: str, remedy: str = "") -> None:
        self.path = Path(path)
        self.reason = f"found {found}, expected {expected}{'; ' if remedy else ''}{remedy}"
        super().__init__(f"{path}: {self.reason}")


class MappingError(HrclogError):
    """A mapping file cannot be used.

    Args:
        path: the file.
        problems: all that is wrong, each with its place in the file; at least one.
    """

    def __init__(self, path: Path, problems: Sequence[str]) -> None:
        self.path = path
        self.problems = tuple(problems)
        lines = [f"{path}: {problem}" for problem in problems]
        super().__init__(lines[0] if len(lines) == 1 else _listed(lines, ScenarioError.MOST))


class ScenarioError(HrclogError):
    """A scenario, problem or plan is not valid.

    Args:
        problems: all that is wrong, each with its place; at least one.
    """

    MOST: Final = 20
    """Problems that the message lists."""

    def __init__(self, *problems: str) -> None:
        self.problems = problems
        super().__init__(problems[0] if len(problems) == 1 else _listed(problems, self.MOST))

    def at(self, where: str) -> ScenarioError:
        """Return the same error with a place before each problem."""
        return ScenarioError(*(f"{where}: {problem}" for problem in self.problems))


def _listed(problems: Sequence[str], most: int) -> str:
    """Return a line for each problem, below one with the file that they share."""
    places = {problem.partition(": ")[0] for problem in problems}
    place = f"{places.pop()}: " if len(places) == 1 else ""
    lines = [f"{place}{len(problems)} problems", *(problem.removeprefix(place) for problem in problems[:most])]
    if len(problems) > most:
        lines.append(f"... and {len(problems) - most} more")
    return "\n  ".join(lines)


class DispatchError(HrclogError):
    """A plan cannot be carried out as asked: by these executors, under this policy."""


class OutputError(HrclogError):
    """A result could not be written where the user asked."""

    REMEDY: Final = "choose another folder with -o or fix its permissions"

    def __init__(self, path: Path | str, reason: str, remedy: str = REMEDY) -> None:
        self.path = Path(path)
        super().__init__(f"{path}: {reason}; {remedy}")


class KnowledgeError(HrclogError):
    """A knowledge base cannot be opened, read or written, or cannot do what was asked."""

    def __init__(self, where: Path | str, found: str, remedy: str) -> None:
        self.where = str(where)
        super().__init__(f"{where}: {found}; {remedy}")
