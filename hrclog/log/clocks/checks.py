"""Compare the clocks of a run's agents: event times against log times, agent by agent."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
import polars as pl

from hrclog.diagnostic import Diagnostic
from hrclog.errors import InvalidEventError
from hrclog.event_rows import parse_details
from hrclog.events import CLOCK_SHIFT, LATEST_NS
from hrclog.log.clocks.offsets import offset_text, seconds_text
from hrclog.log.clocks.series import (
    FEW,
    FEW_NS,
    LEAST_NS,
    RECORDER,
    Series,
    keeps_pace,
    reference,
    series_of,
    timed,
    tolerance_ns,
    written_at_once,
)
from hrclog.log.clocks.shared_steps import shared_steps
from hrclog.log.clocks.steps import Step, own_threshold_ns, steps, threshold_ns
from hrclog.units import NS_PER_S
from hrclog.wording import counted

_SHIFTED_NS: Final = 10 * NS_PER_S  # less may be a delay that all agents share
_DAY_NS: Final = 86_400 * NS_PER_S
_MS: Final = 10**6


def check_clocks(events: pl.DataFrame) -> list[Diagnostic]:
    """Return what is doubtful about clocks, run by run.

    Args:
        events: an events frame in the order of run and time.
    """
    of_recorders = [*_resumed(events), *shared_steps(events)]
    if _all_go_together(events):
        return of_recorders
    runs = timed(_doubtful_runs(events)).partition_by("run_id", as_dict=True, maintain_order=True)
    return [*of_recorders, *(finding for (run_id,), part in runs.items() for finding in _check_run(str(run_id), part))]


def _all_go_together(events: pl.DataFrame) -> bool:
    """Return whether event times and log times of all runs go together, as far as that is told at once."""
    times, written = events["time_ns"], events["log_time_ns"]
    bounds = (times.min(), times.max(), written.min(), written.max())
    if not all(isinstance(bound, int) and abs(bound) <= LATEST_NS for bound in bounds):
        return False
    ahead = times - written
    return _go_together(int(ahead.min()), int(ahead.max()))  # type: ignore[arg-type]  # int64 columns


def _doubtful_runs(events: pl.DataFrame) -> pl.DataFrame:
    """Return the events of runs whose event times and log times do not go together; there are few such runs."""
    plausible = pl.all_horizontal(pl.col(name).is_between(-LATEST_NS, LATEST_NS) for name in ("time_ns", "log_time_ns"))
    ahead = pl.when(plausible).then(pl.col("time_ns") - pl.col("log_time_ns"))
    bounds = events.group_by("run_id").agg(ahead.min().alias("low"), ahead.max().alias("high")).drop_nulls()
    doubtful = [run_id for run_id, low, high in bounds.iter_rows() if not _go_together(low, high)]
    return events.filter(pl.col("run_id").is_in(doubtful))


def _go_together(low: int, high: int) -> bool:
    return high - low < LEAST_NS and max(-low, high) < _SHIFTED_NS


def _check_run(run_id: str, run_events: pl.DataFrame) -> list[Diagnostic]:
    path = str(run_events["path"][0])
    series = series_of(run_events)
    agents = [one for one in series if one.agent != RECORDER]
    if not agents:
        return []
    telling = [one for one in series if one.tells]
    if written_at_once(run_events) or not keeps_pace([one for one in telling if one.agent != RECORDER] or series):
        return [_written_afterwards(run_events, path, run_id)]
    expected_ns = reference(telling)
    threshold = threshold_ns(telling)
    jumps = {
        one.agent: steps(one, own_threshold_ns(one, threshold), expected_ns) for one in telling if one.agent != RECORDER
    }
    found = [_jump(agent, agent_jumps, path, run_id) for agent, agent_jumps in jumps.items() if agent_jumps]
    steady = [one for one in telling if not jumps.get(one.agent)]
    unsteady = [one for one in telling if jumps.get(one.agent)]
    late = [one for one in agents if not one.tells]
    return [
        *found,
        *_offsets(steady, unsteady, threshold, path, run_id),
        *(finding for one in late for finding in _written_late(one, telling, expected_ns, path, run_id)),
    ]


def _written_afterwards(run_events: pl.DataFrame, path: str, run_id: str) -> Diagnostic:
    times, written = (int(np.ptp(run_events[name].to_numpy())) for name in ("time_ns", "log_time_ns"))
    spans = f"events span {times / NS_PER_S:.1f} s, their log times {written / NS_PER_S:.1f} s"
    text = f"{spans}: they were written afterwards, or at another pace, so that clocks of agents cannot be compared"
    return Diagnostic("log_times_untimely", text, path, run_id)


def _written_late(
    one: Series, telling: Sequence[Series], expected_ns: float, path: str, run_id: str
) -> Iterator[Diagnostic]:
    """Yield what is known of the clock of an agent whose events waited: that it is ahead, or nothing."""
    off_ns = one.least_ahead_ns - expected_ns
    if one.waits and telling and off_ns > max(tolerance_ns(fellow) for fellow in telling):
        yield _offset(one, off_ns, [fellow.agent for fellow in telling], path, run_id)
    elif abs(off_ns) > LEAST_NS:
        n_events, written = len(one.seq), (one.written_ns[-1] - one.written_ns[0]) / NS_PER_S
        spans = f"{counted(n_events, 'event')} of {one.agent!r} span {one.span_ns / NS_PER_S:.1f} s"
        text = f"{spans}, their log times {written:.1f} s, several written at once: its clock cannot be compared"
        yield Diagnostic("log_times_untimely", text, path, run_id)


def _offsets(
    steady: Sequence[Series], unsteady: Sequence[Series], threshold: float, path: str, run_id: str
) -> Iterator[Diagnostic]:
    """Yield whose clock is off, or by how much all agents' times are ahead of log times alike.

    Args:
        steady: of the recorder, and of agents whose clocks did not step.
        unsteady: of agents whose clocks did.
        threshold: smallest size of a step, ns.
        path: of the run.
        run_id: of the run.
    """
    agents = [one for one in steady if one.agent != RECORDER]
    if not steady:
        return
    common_ns = reference(agents if agents and _share_level(agents) else steady)
    fellows = [one for one in steady if abs(one.level_ns - common_ns) <= LEAST_NS] or list(steady)
    off = [one for one in agents if _is_off(one, fellows, common_ns)]
    off += [one for one in unsteady if _is_off_throughout(one, common_ns, threshold)]
    for one in sorted(off, key=lambda series: series.agent):
        others = [fellow.agent for fellow in fellows if fellow is not one]
        yield _offset(one, one.level_ns - common_ns, others, path, run_id)
    if agents and abs(common_ns) > max(_SHIFTED_NS, *(tolerance_ns(fellow) for fellow in fellows)):
        yield _shifted(common_ns, path, run_id)


def _is_off(one: Series, fellows: Sequence[Series], common_ns: float) -> bool:
    allowed_ns = min(tolerance_ns(one, fellow) for fellow in fellows)
    if len(one.ahead_ns) <= FEW:
        allowed_ns = max(allowed_ns, FEW_NS)
    return abs(one.level_ns - common_ns) > allowed_ns


def _is_off_throughout(one: Series, common_ns: float, threshold: float) -> bool:
    """Return whether nearly all batches are off to the same side, so that the clock is off besides its steps."""
    low, high = np.quantile(one.ahead_ns, (0.1, 0.9)) - common_ns
    return bool(low > threshold or high < -threshold)


def _share_level(agents: Sequence[Series]) -> bool:
    levels = [one.level_ns for one in agents]
    return max(levels) - min(levels) <= tolerance_ns(*agents)


def _offset(one: Series, off_ns: float, fellows: Sequence[str], path: str, run_id: str) -> Diagnostic:
    offset_ns = round(off_ns / _MS) * _MS
    ordered = sorted(fellows, key=lambda name: (not name, name))
    others = ", ".join(repr(agent) if agent else "the recorder" for agent in ordered) or "the log"
    option = shlex.quote(f"{one.agent}={offset_text(offset_ns)}")
    direction = "ahead of" if offset_ns > 0 else "behind"
    at_least = "at least " if one.waits else ""
    corrects = "takes that off: events waited until they were written" if one.waits else "corrects it"
    text = (
        f"the clock of {one.agent!r} is off by {at_least}{seconds_text(offset_ns)} s, {direction} {others} (event "
        f"times against log times); --clock {option} {corrects}"
    )
    return Diagnostic("clock_offset", text, path, run_id)


def _shifted(common_ns: float, path: str, run_id: str) -> Diagnostic:
    shift_ns = abs(round(common_ns / _MS) * _MS)
    days = f" ({shift_ns / _DAY_NS:.1f} days)" if shift_ns > _DAY_NS else ""
    direction = "later" if common_ns < 0 else "earlier"
    text = f"log times are {seconds_text(shift_ns)[1:]} s{days} {direction} than event times, for all agents alike"
    return Diagnostic("log_times_shifted", text, path, run_id)


def _jump(agent: str, jumps: Sequence[Step], path: str, run_id: str) -> Diagnostic:
    jump = max(jumps, key=lambda step: abs(step.size_ns))
    size = seconds_text(round(jump.size_ns / _MS) * _MS)
    often = "jumps" if len(jumps) == 1 else f"jumps {counted(len(jumps), 'time')}, farthest"
    within = ", while an execution was open" if jump.within_execution else ""
    text = (
        f"the clock of {agent!r} {often} by {size} s between seq {jump.seq_before} and {jump.seq_after}{within} (event "
        "times against log times): durations and overlaps across it are wrong; leave the run out"
    )
    return Diagnostic("clock_jump", text, path, run_id, jump.seq_after)


def _resumed(events: pl.DataFrame) -> list[Diagnostic]:
    """Say where the recorder's clock had been put back, before a run went on or while it was recorded."""
    tells = events["kind"].is_in(["run_started", "annotation_added"])
    if not events["details"].filter(tells).str.contains(CLOCK_SHIFT, literal=True).any():
        return []
    columns = events.filter(tells).select("details", "kind", "path", "run_id", "seq")
    shifted = columns.filter(pl.col("details").str.contains(CLOCK_SHIFT, literal=True))
    return [
        Diagnostic("clock_put_back", _put_back_text(shift_ns, resumed=kind == "run_started"), path, run_id, seq)
        for details, kind, path, run_id, seq in shifted.iter_rows()
        if (shift_ns := _shift_of(details)) > 0
    ]


def _put_back_text(shift_ns: int, *, resumed: bool) -> str:
    size = seconds_text(shift_ns)[1:]
    if resumed:
        return (
            f"the recorder's clock was {size} s behind the run's last event when it went on: "
            "times from there on are shifted by that, and how long the run was interrupted is not known"
        )
    return (
        f"the recorder's clock was put back by {size} s or more between this event and the one before: times from "
        "there on are shifted by that, and how long it was between the two is not known"
    )


def _shift_of(details: str) -> int:
    try:
        shift_ns = parse_details(details).get(CLOCK_SHIFT, 0)
    except InvalidEventError:
        return 0
    return shift_ns if isinstance(shift_ns, int) else 0
