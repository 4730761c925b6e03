"""The tags of runs as columns of tables."""

from __future__ import annotations

from collections.abc import Mapping

import polars as pl


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
