"""Choose runs by their tags: `participant=P01`, `condition!=pilot`."""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from hrclog.errors import HrclogError
from hrclog.tags import value_text
from hrclog.wording import counted

Where = str | Iterable[str] | Mapping[str, object]
"""Conditions on the tags of runs: texts `key=value` and `key!=value`, or by key a value or a list of values."""

ALL_RUNS: Final[tuple[str, ...]] = ()

_FORM: Final = "key=value or key!=value"
_MOST_LISTED: Final = 10


@dataclass(frozen=True, slots=True)
class Condition:
    """What a tag of a run must be, or must not be."""

    key: str
    value: str
    is_equal: bool = True

    def __str__(self) -> str:
        return f"{self.key}{'=' if self.is_equal else '!='}{self.value}"


def conditions(where: Where) -> tuple[Condition, ...]:
    """Return conditions from what a user gives.

    Raises:
        HrclogError: it has another form.
    """
    if isinstance(where, str):
        return (_parsed(where),)
    if isinstance(where, Mapping):
        return tuple(
            Condition(str(key), value_text(key, value))
            for key, values in where.items()
            for value in _listed(key, values)
        )
    if not isinstance(where, Iterable):
        raise HrclogError(f"where: found {where!r}, expected {_FORM}, several of them, or values by key")
    return tuple(map(_parsed, where))


def matching_runs(
    run_ids: Iterable[str], tags: Mapping[str, Mapping[str, str]], wanted: Collection[Condition]
) -> list[str]:
    """Return the runs that meet conditions, in the order they are given.

    Several equalities of one key are alternatives; all else must hold. A run without a tag of that key differs from
    every value.

    Args:
        run_ids: of the runs.
        tags: of runs, as `run_tags` returns them.
        wanted: the conditions.

    Raises:
        HrclogError: no run has a tag of such a key, or none meets the conditions; says what there is.
    """
    runs = list(run_ids)
    known = {key for run in runs for key in tags.get(run, ())}
    for condition in wanted:
        if condition.key not in known:
            keys = ", ".join(map(repr, sorted(known))) or "none, for these runs have no tags"
            similar = [key for key in sorted(known) if key.casefold() == condition.key.casefold()]
            similar = similar or difflib.get_close_matches(condition.key, sorted(known), 1)
            hint = f"; did you mean {similar[0]!r}?" if similar else ""
            raise HrclogError(f"{condition}: no run has a tag {condition.key!r}, expected one of {keys}{hint}")
    matches = [run for run in runs if _meets(tags.get(run, {}), wanted)]
    if not matches:
        raise HrclogError(
            f"{', '.join(map(str, wanted))}: none of {counted(len(runs), 'run')} is so; "
            + "; ".join(_values_text(key, runs, tags) for key in dict.fromkeys(condition.key for condition in wanted))
        )
    return matches


def _parsed(text: object) -> Condition:
    key, sign, value = text.partition("=") if isinstance(text, str) else ("", "", "")
    is_equal = not key.endswith("!")
    key = key.removesuffix("!").strip()
    if not (sign and key):
        raise HrclogError(f"where: found {text!r}, expected {_FORM}")
    return Condition(key, value.strip(), is_equal)


def _listed(key: object, values: object) -> Iterable[object]:
    if isinstance(values, str) or not isinstance(values, Iterable):
        return [values]
    if isinstance(values, Mapping | bytes) or not (listed := list(values)):
        raise HrclogError(f"where: found {values!r} for {key!r}, expected a value or a list of values, one at least")
    return listed


def _meets(tags: Mapping[str, str], wanted: Collection[Condition]) -> bool:
    alternatives: dict[str, set[str]] = {}
    for condition in wanted:
        if condition.is_equal:
            alternatives.setdefault(condition.key, set()).add(condition.value)
        elif tags.get(condition.key, "") == condition.value:
            return False
    return all(tags.get(key, "") in values for key, values in alternatives.items())


def _values_text(key: str, runs: list[str], tags: Mapping[str, Mapping[str, str]]) -> str:
    counts = Counter(tags.get(run, {}).get(key, "") for run in runs)
    listed = [f"{value or 'not set'} ({counted(count, 'run')})" for value, count in sorted(counts.items())]
    others = [f"{len(listed) - _MOST_LISTED} more"] if len(listed) > _MOST_LISTED else []
    return f"{key} is {', '.join([*listed[:_MOST_LISTED], *others])}"
