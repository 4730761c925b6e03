"""The tags of runs as columns of tables, and as text."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import polars as pl

from hrclog.analyzers.projections.schemas import RUNS

_MOST_VALUES = 6


def tag_columns(table: pl.DataFrame, tags: Mapping[str, Mapping[str, str]]) -> dict[str, str]:
    """Return by key the name that a tag's column has in a table: the key, or `tag_KEY` where that is taken.

    Args:
        table: the table without tags.
        tags: of runs by their ids, as `run_tags` returns them.
    """
    taken = set(table.columns)
    names: dict[str, str] = {}
    for key in sorted({key for of_run in tags.values() for key in of_run}):
        name = key
        while name in taken:
            name = f"tag_{name}"
        names[key] = name
        taken.add(name)
    return names


def with_tags(table: pl.DataFrame, tags: Mapping[str, Mapping[str, str]]) -> pl.DataFrame:
    """Return a table with a column `run_id` with a further column per tag, "" where a run has none of that key.

    Args:
        table: the table without tags.
        tags: of runs by their ids, as `run_tags` returns them.
    """
    if not tags:
        return table
    runs = table["run_id"].to_list()
    columns = [
        pl.Series(name, [tags.get(run, {}).get(key, "") for run in runs], pl.String)
        for key, name in tag_columns(table, tags).items()
    ]
    return table.with_columns(columns)


def tag_names(runs: pl.DataFrame) -> list[str]:
    """Return the columns of a table of runs that are tags.

    Args:
        runs: schema `RUNS`, and tags.
    """
    return [name for name in runs.columns if name not in RUNS]


def run_record(run: Mapping[str, Any], tags: Mapping[str, Mapping[str, str]]) -> dict[str, Any]:
    """Return a row of a table of runs for JSON: the columns of `RUNS`, and its tags by key in `tags`.

    Args:
        run: the row.
        tags: of runs by their ids; a column may have another name than the tag's.
    """
    return {name: run[name] for name in RUNS} | {"tags": dict(tags.get(run["run_id"], {}))}


def tags_text(run: Mapping[str, Any]) -> str:
    """Return the tags of a run as a text, such as `condition=fast, participant=P01`.

    Args:
        run: a row of a table of runs.
    """
    return ", ".join(f"{key}={value}" for key, value in run.items() if key not in RUNS and value)


def run_label(run: Mapping[str, Any]) -> str:
    """Return the name of a run and its tags; its id where it has no name.

    Args:
        run: a row of a table of runs.
    """
    name, tags = str(run["name"] or run["run_id"]), tags_text(run)
    return f"{name} ({tags})" if tags else name


def run_labels(runs: pl.DataFrame) -> list[str]:
    """Return the labels of the runs of a table, in its order."""
    return [run_label(row) for row in runs.select("run_id", "name", *tag_names(runs)).iter_rows(named=True)]


def tags_summary(runs: pl.DataFrame) -> str:
    """Return which tags runs have: each value and its count, or how many values where there are many.

    Args:
        runs: schema `RUNS`, and tags.
    """
    return "; ".join(f"{name} {_values_text(runs[name])}" for name in tag_names(runs))


def _values_text(values: pl.Series) -> str:
    counts = sorted(Counter(values.to_list()).items())
    if len(counts) > _MOST_VALUES:
        return f"({len(counts)} values)"
    return ", ".join(f"{value or 'not set'} ({count})" for value, count in counts)
