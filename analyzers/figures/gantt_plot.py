"""The timeline of a run as a plot: a row per lane, bars over seconds."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from hrclog.analyzers.figures.gantt import Bar, Gantt, Lane
from hrclog.analyzers.figures.palette import FAILED, FULL_SPEED, PAUSED, REDUCED, ink_on
from hrclog.analyzers.figures.plot import WIDE, Axis, Key, Plot, Rect, Text
from hrclog.analyzers.figures.text import shorten

HOW_TO_READ: Final = (
    "Each bar is an execution; below what an agent did stands, pale, what was planned for it, and its safety state. "
    "✗ failed or timed out, || paused, - canceled or skipped, #2 a second attempt; gaps are idle time."
)

LEFT: Final = 200
"""Px for the names of lanes and of signals, so that all plots share one time axis."""

_MOST_TASKS: Final = 16
_ROW: Final = 30
_HALF: Final = {"done": 0.44, "planned": 0.28, "safety": 0.2}
_NAMES: Final = {"done": "", "planned": "planned", "safety": "safety"}
_S: Final = 1e9


def gantt_plot(gantt: Gantt, path: tuple[str, ...]) -> Plot:
    """Return the timeline: lanes from the top, agents in the order of the Rerun timeline."""
    rows = list(enumerate(gantt.lanes))
    count = max(len(rows), 1)
    x = seconds_axis(gantt)
    bars = [(lane, row + 0.5, bar) for row, lane in rows for bar in lane.bars]
    px_per_s = WIDE / (x.high - x.low)
    return Plot(
        path=path,
        title="Timeline",
        reading=HOW_TO_READ,
        x=x,
        y=Axis(count, 0, ticks=tuple((row + 0.5, _name(lane)) for row, lane in rows)),
        area=(WIDE, count * _ROW),
        rects=tuple(_rect(lane, y, bar) for lane, y, bar in bars),
        texts=tuple(text for lane, y, bar in bars for text in _texts(lane, y, bar, px_per_s)),
        keys=_keys(gantt),
        left=LEFT,
    )


def seconds_axis(gantt: Gantt) -> Axis:
    """Return the time axis that the timeline and the signals of a run share, s since its first event."""
    low, high = gantt.start_ns / _S, gantt.end_ns / _S
    margin = max((high - low) / 200, 1e-3)
    return Axis(low - margin, high + margin, "seconds since the run's first event", grid=True)


def _name(lane: Lane) -> str:
    kind = _NAMES[lane.kind]
    number = f" ({lane.number + 1})" if lane.number else ""
    return f"{shorten(lane.agent, 30)}{f', {kind}' if kind else ''}{number}"


def _rect(lane: Lane, y: float, bar: Bar) -> Rect:
    start, end, half = bar.start_ns / _S, bar.end_ns / _S, _HALF[lane.kind]
    return Rect((start, y - half), (end, y + half), bar.color, f"{bar.label}: {start:.2f} to {end:.2f} s")


def _texts(lane: Lane, y: float, bar: Bar, px_per_s: float) -> Iterator[Text]:
    """Yield a bar's label, or only its beginning if the whole does not fit."""
    if lane.kind == "safety":
        return
    start, end = bar.start_ns / _S, bar.end_ns / _S
    size = 12 if lane.kind == "done" else 10
    most = int((end - start) * px_per_s / (_CHARACTER * size))
    label = (
        bar.label
        if len(bar.label) <= most
        else f"{bar.label[: most - 1].rstrip()}…"
        if most > _FEWEST
        else bar.label[:most]
    )
    if label:
        yield Text(((start + end) / 2, y), label, ink_on(bar.color), size, room=end - start)


_CHARACTER: Final = 0.62
"""Width of a letter over the height of the font, rather too wide."""
_FEWEST: Final = 3


def _keys(gantt: Gantt) -> tuple[Key, ...]:
    """Return the legend: colours of tasks, unless there are many, and colours of failures, pauses and safety states."""
    bar_colors = {bar.color for lane in gantt.lanes for bar in lane.bars}
    safety_colors = {bar.color for lane in gantt.lanes if lane.kind == "safety" for bar in lane.bars}
    entries = (
        ("failed or timed out", FAILED, bar_colors - safety_colors),
        ("paused", PAUSED, bar_colors),
        ("full speed", FULL_SPEED, safety_colors),
        ("slowed down", REDUCED, safety_colors),
        ("stopped", FAILED, safety_colors),
    )
    tasks = [Key(name, color) for name, color in gantt.tasks]
    event_keys = (Key(label, color) for label, color, among in entries if color in among)
    return (*(tasks if len(tasks) <= _MOST_TASKS else ()), *event_keys)
