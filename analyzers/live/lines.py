"""The lines of a run that goes on: samples that are new, and what is held or adds up until now."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Final

import numpy as np
import polars as pl

from hrclog.analyzers.figures.series import MAX_SERIES, Series, speed_scales
from hrclog.analyzers.live.executions import LiveExecutions

LAG_NS: Final = 1_000_000_000
"""What is held or adds up is drawn up to so long ago: of what has happened since, not all may have been told."""

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
        """Return the samples that come after those that were taken in."""
        known = pl.DataFrame(
            list(self._sampled_ns.items()), schema={"name": pl.String, "until_ns": pl.Int64}, orient="row"
        )
        joined = signals.join(known, on="name", how="left", maintain_order="left")
        return joined.filter(pl.col("until_ns").is_null() | (pl.col("time_ns") > pl.col("until_ns"))).drop("until_ns")

    def news(
        self, series: Iterable[Series], safety: pl.DataFrame, executions: LiveExecutions, now_ns: int, *, alive: bool
    ) -> tuple[Series, ...]:
        """Return what is to be drawn.

        Args:
            series: of the signals that are new; others are passed over.
            safety: the safety states from the last known one of each agent on.
            executions: for the time in which agents have worked at once.
            now_ns: since the epoch.
            alive: more may be told of what has just happened.
        """
        until_ns = now_ns - LAG_NS if alive else now_ns
        held = speed_scales(safety, self._origin_ns, until_ns)
        added = executions.overlaps(self._origin_ns, until_ns)
        other = {one.group for one in (*held, *added)}
        signals = [one for one in series if not one.step and one.group not in other]
        found = [*held, *filter(self._has_room, signals), *(self._rest(one, until_ns) for one in added)]
        for one in found:
            self._drawn.setdefault((one.group, one.name), replace(one, times_ns=_NOTHING, values=np.empty(0)))
        return tuple(one for one in found if len(one.times_ns))

    def outline(self) -> tuple[Series, ...]:
        """Return the lines that there are, without samples, in the order in which a layout has them."""

        def place(key: tuple[str, str]) -> tuple[bool, int, tuple[str, str]]:
            series = self._drawn[key]
            return series.joint, 0 if series.step else 2 if key in self._until_ns else 1, key

        return tuple(self._drawn[key] for key in sorted(self._drawn, key=place))

    def _has_room(self, series: Series) -> bool:
        signals = [one for one in self._drawn.values() if not one.step]
        return (series.group, series.name) in self._drawn or len(signals) < MAX_SERIES

    def _rest(self, series: Series, until_ns: int) -> Series:
        """Return what of a line that adds up was not drawn yet."""
        key = series.group, series.name
        last = self._until_ns.setdefault(key, -1)
        new = (series.times_ns > last) & (series.times_ns <= until_ns - self._origin_ns)
        if new.any():
            self._until_ns[key] = int(series.times_ns[new][-1])
        return replace(series, times_ns=series.times_ns[new], values=series.values[new])
