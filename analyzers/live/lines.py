"""The lines of a run in progress: new samples, and values that are held or add up until now."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Final

import numpy as np
import polars as pl

from hrclog.analyzers.figures.series import MAX_SERIES, Series, speed_scales
from hrclog.analyzers.live.executions import LiveExecutions

LAG_NS: Final = 1_000_000_000
"""Values that are held or add up are drawn up to so long ago, because later events may not have arrived yet."""

_NOTHING: Final = np.empty(0, np.int64)


class LiveLines:
    """The lines of one run.

    Args:
        origin_ns: becomes 0.
    """

    def __init__(self, origin_ns: int) -> None:
        self._origin_ns = origin_ns
        self._drawn: dict[tuple[str, str], Series] = {}  # without samples
        self._until_ns: dict[tuple[str, str], int] = {}  # of what adds up
        self._sampled_ns: dict[str, int] = {}

    def sampled(self, signals: pl.DataFrame) -> None:
        """Remember up to when each signal was sampled."""
        for name, time_ns in signals.group_by("name").agg(pl.col("time_ns").max()).iter_rows():
            self._sampled_ns[name] = max(time_ns, self._sampled_ns.get(name, time_ns))

    def unseen(self, signals: pl.DataFrame) -> pl.DataFrame:
        """Return the samples that are later than those taken in already."""
        sampled = pl.DataFrame(
            list(self._sampled_ns.items()), schema={"name": pl.String, "until_ns": pl.Int64}, orient="row"
        )
        joined = signals.join(sampled, on="name", how="left", maintain_order="left")
        return joined.filter(pl.col("until_ns").is_null() | (pl.col("time_ns") > pl.col("until_ns"))).drop("until_ns")

    def news(
        self, series: Iterable[Series], safety: pl.DataFrame, executions: LiveExecutions, now_ns: int, *, alive: bool
    ) -> tuple[Series, ...]:
        """Return the samples to draw.

        Args:
            series: series with new signals; other series are ignored.
            safety: the safety states from the last known one of each agent on.
            executions: for the time in which agents have worked at the same time.
            now_ns: since the epoch.
            alive: whether further events of the last moments may arrive.
        """
        until_ns = now_ns - LAG_NS if alive else now_ns
        scales = speed_scales(safety, self._origin_ns, until_ns)
        overlap_lines = executions.overlaps(self._origin_ns, until_ns)
        other_groups = {line.group for line in (*scales, *overlap_lines)}
        signals = [line for line in series if not line.step and line.group not in other_groups]
        lines = [
            *scales,
            *filter(self._has_room, signals),
            *(self._undrawn_part(line, until_ns) for line in overlap_lines),
        ]
        for line in lines:
            self._drawn.setdefault((line.group, line.name), replace(line, times_ns=_NOTHING, values=np.empty(0)))
        return tuple(line for line in lines if len(line.times_ns))

    def outline(self) -> tuple[Series, ...]:
        """Return all lines without samples, in the order of a layout."""

        def place(key: tuple[str, str]) -> tuple[bool, int, tuple[str, str]]:
            series = self._drawn[key]
            return series.joint, 0 if series.step else 2 if key in self._until_ns else 1, key

        return tuple(self._drawn[key] for key in sorted(self._drawn, key=place))

    def _has_room(self, series: Series) -> bool:
        signals = [line for line in self._drawn.values() if not line.step]
        return (series.group, series.name) in self._drawn or len(signals) < MAX_SERIES

    def _undrawn_part(self, series: Series, until_ns: int) -> Series:
        """Return the part of a cumulative line that was not drawn yet."""
        key = series.group, series.name
        last = self._until_ns.setdefault(key, -1)
        new = (series.times_ns > last) & (series.times_ns <= until_ns - self._origin_ns)
        if new.any():
            self._until_ns[key] = int(series.times_ns[new][-1])
        return replace(series, times_ns=series.times_ns[new], values=series.values[new])
