"""Put facts on one clock: a replay logs messages days after they were stamped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import median
from typing import Final

from hrclog.diagnostic import Diagnostic
from hrclog.recorders.mapping.facts import Clock, Fact, Notes
from hrclog.units import NS_PER_S

_DAY_NS: Final = 86_400 * NS_PER_S
_CLEAR_NS: Final = 60 * NS_PER_S
_SPREAD_NS: Final = 5 * NS_PER_S
_MOST_OUTLIERS: Final = 0.2
_YEAR_2000_NS: Final = 946_684_800 * NS_PER_S


@dataclass(frozen=True, slots=True)
class Offset:
    """How much later messages were logged than stamped."""

    ns: int
    is_steady: bool
    is_simulated: bool


def on_one_clock(facts: Sequence[Fact], notes: Notes, path: str) -> tuple[list[Fact], list[Diagnostic]]:
    """Return facts with their times on one clock, and what is to be said of it.

    Stamps count where log times are far from all of them by the same time; where stamps are those of a simulated clock,
    log times count.

    Args:
        facts: of one recording.
        notes: tell when stamped messages were logged.
        path: of the recording.
    """
    offset = _offset(notes)
    clocks = {fact.clock for fact in facts}
    if offset is None or Clock.LOG not in clocks or (offset.is_simulated and Clock.STAMP not in clocks):
        return list(facts), []
    later = f"log times are {_span(offset.ns)} than the stamps of the messages"
    if not offset.is_steady:
        text = f"{later}, and do not keep pace with them (a replay?): what has no stamp of its own has wrong times"
        return list(facts), [Diagnostic("replayed_times", text, path)]
    if offset.is_simulated:
        text = f"{later}, which are of a simulated clock: stamps were turned into log times"
        moved, shift = Clock.STAMP, offset.ns
    else:
        text = f"{later}: log times were turned into such stamps"
        moved, shift = Clock.LOG, -offset.ns
    return [_moved(fact, shift) if fact.clock is moved else fact for fact in facts], [
        Diagnostic("log_times_shifted", text, path)
    ]


def _offset(notes: Notes) -> Offset | None:
    """Return how much later messages were logged, None where that is not clearly more than a delay."""
    pairs = notes.sure_stamps or notes.other_stamps
    if not pairs:
        return None
    delays = sorted(log_ns - stamp_ns for log_ns, stamp_ns in pairs)
    middle = int(median(delays))
    if abs(middle) < (_CLEAR_NS if notes.sure_stamps else _DAY_NS):
        return None
    near = [delay for delay in delays if abs(delay - middle) <= _SPREAD_NS]
    is_steady = len(near) >= (1 - _MOST_OUTLIERS) * len(delays)
    stamps = int(median(stamp_ns for _, stamp_ns in pairs))
    return Offset(min(near) if near else middle, is_steady, stamps < _YEAR_2000_NS)


def _moved(fact: Fact, shift: int) -> Fact:
    return Fact(replace(fact.content, time_ns=fact.time_ns + shift), fact.clock)


def _span(ns: int) -> str:
    days, seconds = abs(ns) / _DAY_NS, abs(ns) / NS_PER_S
    return f"{f'{days:,.1f} days' if days >= 1 else f'{seconds:,.0f} s'} {'later' if ns > 0 else 'earlier'}"
