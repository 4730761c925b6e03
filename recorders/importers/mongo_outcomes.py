"""What the `outcome` of a task result means: 1 and 0, hrclog's own words, and words that the user explains."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from hrclog.diagnostic import Diagnostic
from hrclog.errors import HrclogError
from hrclog.events import OUTCOME_NOT_TOLD, UNKNOWN_OUTCOME, Outcome
from hrclog.wording import counted

UNSET: Final = ""
"""Outcome of an end whose row does not tell it; a reader takes it for unknown."""

_MEANINGS: Final[dict[str, str]] = {
    "1": Outcome.SUCCEEDED.value,
    "true": Outcome.SUCCEEDED.value,
    "0": Outcome.FAILED.value,
    "false": Outcome.FAILED.value,
} | {outcome.value: outcome.value for outcome in Outcome}
_LONGEST: Final = 80  # characters of a strange value


class Outcomes:
    """The meanings of outcomes, those that the user explains first.

    Args:
        ok: words, in any case, or numbers that mean succeeded.
        failed: that mean failed.
        canceled: that mean canceled.

    Raises:
        HrclogError: a word is given two meanings.
    """

    def __init__(self, ok: Sequence[str] = (), failed: Sequence[str] = (), canceled: Sequence[str] = ()) -> None:
        explained: dict[str, str] = {}
        for outcome, words in ((Outcome.SUCCEEDED, ok), (Outcome.FAILED, failed), (Outcome.CANCELED, canceled)):
            for word in words:
                if explained.setdefault(_word(word), outcome.value) != outcome.value:
                    problem = f"found the outcome {word!r} for {explained[_word(word)]} and for {outcome}"
                    raise HrclogError(f"{problem}, expected one meaning; give it to one of --ok, --failed, --canceled")
        self._meanings = _MEANINGS | explained

    def of(self, row: Mapping[str, Any]) -> str:
        """Return the outcome of a row, `UNSET` where it does not tell one; a number of unknown meaning is a failure."""
        value = row.get("outcome")
        meaning = self._meanings.get(_word(value))
        if meaning is not None:
            return meaning
        return Outcome.FAILED.value if _is_number(value) else UNSET

    def reason(self, row: Mapping[str, Any]) -> str:
        """Return why a row did not succeed, in its own word; "" where it succeeded."""
        if self.of(row) == Outcome.SUCCEEDED:
            return ""
        return "no outcome" if _is_missing(row) else f"outcome {_shown(row['outcome'])}"

    def not_told(self, row: Mapping[str, Any]) -> dict[str, str]:
        """Return the detail that marks a row as one of unknown outcome, among others that tell theirs."""
        if self.of(row) != UNSET:
            return {}
        return {OUTCOME_NOT_TOLD: "" if _is_missing(row) else _shown(row["outcome"])}

    def diagnostics(self, rows: Iterable[tuple[Path, Mapping[str, Any]]]) -> list[Diagnostic]:
        """Return the values of unknown meaning, how often each is there, and what was made of it."""
        unknown: Counter[tuple[Path, str, str]] = Counter()
        for source, row in rows:
            if _word(row.get("outcome")) not in self._meanings:
                made = self.of(row) or UNKNOWN_OUTCOME
                unknown[source, "" if _is_missing(row) else _shown(row["outcome"]), made] += 1
        return [
            Diagnostic("unknown_outcome", _problem(shown, made, count), str(source))
            for (source, shown, made), count in unknown.items()
        ]


def _problem(shown: str, made: str, count: int) -> str:
    executions = counted(count, "execution")
    if not shown:
        return f"found no outcome in {executions}, expected 1 or 0; it counts as {made}"
    remedy = "say what it means (hrclog import mongo --ok, --failed or --canceled)"
    return f"found the outcome {shown} in {executions}, expected 1 or 0; it counts as {made}: {remedy}"


def _word(value: Any) -> str:  # noqa: ANN401 - any JSON value
    """Return a value as the word that it is looked up by; "" for those that are no word."""
    if isinstance(value, bool):
        return str(value).lower()
    if _is_number(value):
        return str(int(value)) if float(value).is_integer() else repr(value)
    return value.strip().casefold() if isinstance(value, str) else ""


def _is_number(value: Any) -> bool:  # noqa: ANN401 - any JSON value
    # an integer may be larger than any float
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 2**63


def _is_missing(row: Mapping[str, Any]) -> bool:
    value = row.get("outcome")
    return value is None or (isinstance(value, str) and not value.strip())


def _shown(value: Any) -> str:  # noqa: ANN401 - any JSON value
    return repr(value)[:_LONGEST]
