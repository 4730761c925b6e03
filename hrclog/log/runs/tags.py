"""The tags of runs, as their events tell them."""

from __future__ import annotations

from typing import Final

import polars as pl

from hrclog.errors import InvalidEventError
from hrclog.event_rows import readable_details
from hrclog.events import RunStarted
from hrclog.log.annotations.said import Said, said_in
from hrclog.log.remarks import said_among
from hrclog.tags import TAGS, value_text

_MEMBER: Final = f'"{TAGS}"'


def run_tags(events: pl.DataFrame) -> dict[str, dict[str, str]]:
    """Return the tags of each run that has any, its keys in order.

    A later segment of a run adds to what the first one tells, an annotation to both; what was said last holds. What is
    no text or number is no tag.

    Args:
        events: an events frame.
    """
    tags: dict[str, dict[str, str]] = {}
    for run_id, details in _telling(events).select("run_id", "details").iter_rows():
        tags.setdefault(run_id, {}).update(_tags(readable_details(details).get(TAGS)))
    annotations = said_among(events).select("run_id", "details").iter_rows()
    for run_id, said in sorted(((run_id, said_in(details)) for run_id, details in annotations), key=_when):
        tags.setdefault(run_id, {}).update(said.tags)
    tags = {run_id: {key: value for key, value in of_run.items() if value} for run_id, of_run in tags.items()}
    return {run_id: dict(sorted(of_run.items())) for run_id, of_run in sorted(tags.items()) if of_run}


def _telling(events: pl.DataFrame) -> pl.DataFrame:
    """Return the starts of runs that tell tags, in the order of their runs' segments."""
    started = events.filter(pl.col("kind") == RunStarted.kind)
    return started.filter(pl.col("details").str.contains(_MEMBER, literal=True)).sort("run_id", "seq")


def _when(entry: tuple[str, Said]) -> int:
    return entry[1].at_ns


def _tags(value: object) -> dict[str, str]:
    tags: dict[str, str] = {}
    for key, entry in value.items() if isinstance(value, dict) else ():
        try:
            tags[str(key)] = value_text(key, entry)
        except InvalidEventError:
            continue
    return tags
