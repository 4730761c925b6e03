"""Words of tables: how an execution ended, and what an event of a life cycle did."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import polars as pl

from hrclog.errors import HrclogError
from hrclog.events import Outcome
from hrclog.recorders.importers.table.mapping import TableMapping

OUTCOME_WORDS: Final[dict[str, str]] = {outcome.value: outcome.value for outcome in Outcome} | {
    "success": Outcome.SUCCEEDED.value,
    "failure": Outcome.FAILED.value,
    "aborted": Outcome.FAILED.value,
    "cancelled": Outcome.CANCELED.value,
    "timed out": Outcome.TIMED_OUT.value,
    "timeout": Outcome.TIMED_OUT.value,
}
"""Outcomes that say themselves what they mean; all others are for the user to explain."""

START: Final = "start"
END: Final = "end"
PAUSE: Final = "pause"
RESUME: Final = "resume"
POINT: Final = "point"

EVENT_WORDS: Final[dict[str, str]] = (
    dict.fromkeys(("start", "started", "begin", "began", "task_started", "executing", "running"), START)
    | dict.fromkeys(("end", "ended", "stop", "stopped", "complete", "completed", "finish", "finished", "done"), END)
    | dict.fromkeys(("task_ended", *OUTCOME_WORDS, "ate_abort", "pi_abort"), END)
    | dict.fromkeys(("pause", "paused", "suspend", "suspended", "task_paused"), PAUSE)
    | dict.fromkeys(("resume", "resumed", "task_resumed"), RESUME)
    | dict.fromkeys(("point",), POINT)
)
"""Words of a life cycle, those of XES and BORIS among them."""

_EVENT_OUTCOMES: Final = OUTCOME_WORDS | {"ate_abort": Outcome.FAILED.value, "pi_abort": Outcome.CANCELED.value}


def outcome_meanings(mapping: TableMapping) -> dict[str, str]:
    """Return outcomes by their words, those that the user explained first.

    Raises:
        HrclogError: a word is given two meanings.
    """
    return OUTCOME_WORDS | _explained(mapping)


def _explained(mapping: TableMapping) -> dict[str, str]:
    return _by_word(
        {
            "--ok": (Outcome.SUCCEEDED.value, mapping.ok),
            "--failed": (Outcome.FAILED.value, mapping.failed),
            "--canceled": (Outcome.CANCELED.value, mapping.canceled),
        }
    )


def event_meanings(mapping: TableMapping) -> tuple[dict[str, str], dict[str, str]]:
    """Return what the words of events do, and the outcomes of those that end an execution with one.

    Raises:
        HrclogError: a word is given two meanings.
    """
    told = _by_word(
        {
            "--started": (START, mapping.started),
            "--ended": (END, mapping.ended),
            "--paused": (PAUSE, mapping.paused),
            "--resumed": (RESUME, mapping.resumed),
            "--points": (POINT, mapping.points),
        }
    )
    outcomes = _EVENT_OUTCOMES | _explained(mapping)
    return EVENT_WORDS | dict.fromkeys(outcomes, END) | told, outcomes


def _by_word(words: Mapping[str, tuple[str, Sequence[str]]]) -> dict[str, str]:
    meanings: dict[str, tuple[str, str]] = {}
    for option, (meaning, listed) in words.items():
        for word in listed:
            other, _ = meanings.setdefault(folded(word), (option, meaning))
            if other != option:
                raise HrclogError(
                    f"found {word!r} for {other} and for {option}, expected one meaning; give it to one of them"
                )
    return {word: meaning for word, (_, meaning) in meanings.items()}


def folded(word: str) -> str:
    """Return a word as it is looked up."""
    return word.strip().lower()


def folded_words(values: pl.Series) -> pl.Series:
    """Return the words of a column as they are looked up, "" for an empty cell; whole floats as integers."""
    return texts_of(values).str.to_lowercase()


def texts_of(values: pl.Series) -> pl.Series:
    """Return the texts of a column, stripped, "" for an empty cell.

    Whole floats are as integers: a column of whole numbers becomes one of floats where a cell is empty.
    """
    if values.dtype.is_float():
        whole = values.cast(pl.Int64, strict=False)
        is_whole = (values == whole.cast(pl.Float64)).fill_null(value=False)
        texts = pl.select(pl.when(is_whole).then(whole.cast(pl.String)).otherwise(values.cast(pl.String))).to_series()
    else:
        texts = values.cast(pl.String)
    return texts.str.strip_chars().fill_null("")
