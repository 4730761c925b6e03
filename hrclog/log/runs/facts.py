"""What the start of a run tells of it: its name and its agents."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import polars as pl

from hrclog.event_rows import readable_details
from hrclog.events import RunStarted


@dataclass(frozen=True, slots=True)
class RunFacts:
    """The name of a run, that of its file where it has none, and the agents that its start names."""

    name: str
    agents: tuple[str, ...] = ()


def run_facts(events: pl.DataFrame) -> dict[str, RunFacts]:
    """Return by run what its first `run_started` tells.

    Args:
        events: an events frame.
    """
    files = events.sort("run_id", "seq").unique("run_id", keep="first", maintain_order=True)
    facts = {run: RunFacts(_stem(path)) for run, path in files.select("run_id", "path").iter_rows()}
    started = events.filter(pl.col("kind") == RunStarted.kind).sort("run_id", "seq").unique("run_id", keep="first")
    for run, details in started.select("run_id", "details").sort("run_id").iter_rows():
        name, agents = _declared(details)
        facts[run] = RunFacts(name or facts[run].name, agents)
    return facts


def _declared(details: str) -> tuple[str, tuple[str, ...]]:
    facts = readable_details(details)
    return _text(facts.get("name")), tuple(_text(agent) for agent in _items(facts.get("agents")))


def _stem(path: str) -> str:
    return Path(path).name.removesuffix(".partial").removesuffix(".mcap")


def _items(value: object) -> Iterable[object]:
    return value if isinstance(value, list) else []


def _text(value: object) -> str:
    return value if isinstance(value, str) else ""
