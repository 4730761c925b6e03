"""How hypothesis draws events: every class, with anything in its fields that may be written."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from hypothesis import strategies as st

from hrclog.events import EVENT_CLASSES, LATEST_NS, TASK_KINDS, Cause, Event, Outcome, Role

INT64 = st.integers(-(2**63) + 1, 2**63 - 1)  # the least one means unset
INSTANTS = st.integers(-LATEST_NS, LATEST_NS)
NAMES = st.text(min_size=1, max_size=8).filter(str.strip)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)
FIELDS: dict[str, st.SearchStrategy[Any]] = {
    "time_ns": st.integers(0, LATEST_NS),
    "seq": st.integers(0, 2**63 - 1),
    "attempt": st.integers(0, 2**32 - 1),
    "segment": st.integers(1),
    "seed": st.none() | st.integers(),
    "agent": NAMES,
    "task": NAMES,
    "execution_id": NAMES,
    "outcome": st.sampled_from(list(Outcome)).map(str),
    "cause": st.sampled_from(list(Cause)).map(str),
    "role": st.sampled_from(list(Role)).map(str),
    "speed_scale": st.none() | st.floats(0.0, 1.0),
    "agents": st.lists(st.text(max_size=5), max_size=3).map(tuple),
    "plan": JSON,
    "task_properties": JSON,
    "software": st.dictionaries(st.text(max_size=5), st.text(max_size=5), max_size=2),
}
DETAILS = st.dictionaries(st.text(max_size=5).map("_{}".format), JSON, max_size=2)


def events_of(cls: type[Event]) -> st.SearchStrategy[Event]:
    """Return valid events of a class, with anything in their fields that may be written."""
    drawn = {field.name: _field(field.name, str(field.type)) for field in fields(cls)}
    return st.builds(cls, **drawn)


def _field(name: str, kind: str) -> st.SearchStrategy[Any]:
    if name == "details":
        return DETAILS
    if name in FIELDS:
        return FIELDS[name]
    if "int" in kind:
        return st.none() | (INSTANTS if name.endswith("_ns") else INT64)
    return st.none() | st.floats(allow_nan=False) if "float" in kind else st.text(max_size=20)


EVENTS = st.one_of(*map(events_of, EVENT_CLASSES.values()))
TASK_FACTS = st.one_of(*(events_of(EVENT_CLASSES[kind]) for kind in TASK_KINDS))
