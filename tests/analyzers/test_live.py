"""Runs that go on: whatever is drawn piece by piece is, in the end, the picture of the whole run."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import polars as pl
from event_frames import LEGAL, event, event_rows
from event_frames import frame as frame_of
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.analyzers.figures import RunFigures, run_figures
from hrclog.analyzers.figures.events import event_lines
from hrclog.analyzers.figures.gantt import Lane, execution_lanes, state_changes
from hrclog.analyzers.intervals import rebuild
from hrclog.analyzers.live_lanes import LaneKey
from hrclog.analyzers.live_run import LivePart, LiveRun
from hrclog.analyzers.runs import runs
from hrclog.log.checks import usable
from hrclog.log.message import EVENTS
from hrclog.log.signals import SIGNAL_COLUMNS

SAMPLES = Path(__file__).parents[2] / "sample_logs"
S = 1_000_000_000
NO_SIGNALS = SIGNAL_COLUMNS.to_frame()

States = dict[int, str]
"""What a lane shows from each instant on."""


def frame(rows: Iterable[dict[str, Any]]) -> pl.DataFrame:
    return frame_of(rows).select(EVENTS.names())


def batches(events: pl.DataFrame, cuts: Iterable[int]) -> list[pl.DataFrame]:
    edges = [0, *sorted(cuts), events.height]
    return [events[start:end] for start, end in pairwise(edges) if end > start]


def said(parts: Iterable[LivePart]) -> dict[LaneKey, States]:
    """Return what lanes show: of what is said of one instant, the last counts."""
    lanes: dict[LaneKey, States] = {}
    for part in parts:
        for key, news in part.lanes.items():
            lanes.setdefault(key, {}).update(zip(news.times_ns, news.states, strict=True))
    return lanes


def shown(states: States, instants: Iterable[int]) -> list[str]:
    times = sorted(states)
    return [states[times[at - 1]] if (at := bisect_right(times, instant)) else "" for instant in instants]


def is_same(lanes: Mapping[LaneKey, States], expected: Iterable[Lane], kinds: tuple[str, ...]) -> None:
    """Assert that lanes show the bars of others at every instant, and that further lanes show none."""
    wanted = {(lane.agent, lane.kind, lane.number): dict(zip(*state_changes(lane), strict=True)) for lane in expected}
    for key in (key for key in {**lanes, **wanted} if key[1] in kinds):
        found, right = lanes.get(key, {}), wanted.get(key, {})
        instants = sorted({*found, *right})
        assert shown(found, instants) == shown(right, instants), key


def whole(events: pl.DataFrame) -> RunFigures:
    events = usable(events).sort("time_ns", "seq", maintain_order=True)
    executions, _ = rebuild(events)
    return run_figures(runs(events, executions).row(0, named=True), executions, events, NO_SIGNALS)


@settings(max_examples=12)
@given(rows=event_rows(), data=st.data())
def test_a_run_drawn_in_any_pieces_is_in_the_end_the_picture_of_the_whole_run(
    rows: list[dict[str, Any]], data: st.DataObject
) -> None:
    own = [row for row in rows if row["run_id"] == "r"]
    events = frame([event("run_started", 0, run_id="r"), *own])
    pieces = batches(events, data.draw(st.lists(st.integers(1, events.height), max_size=4)))
    run = LiveRun(pieces[0])
    parts = [run.part(run.latest_ns, alive=True)]
    for piece in pieces[1:]:
        run.take(piece)
        parts.append(run.part(run.latest_ns, alive=data.draw(st.booleans())))
    figures = whole(events)
    parts.append(run.last_part(figures))
    is_same(said(parts), figures.gantt.lanes, ("done", "planned", "safety"))
    lines = [text for part in parts for text in part.figures.events.texts]
    assert lines == list(event_lines(events, 0).texts)


@st.composite
def lives(draw: st.DrawFn) -> pl.DataFrame:
    """Draw the events of a few executions that break no rule, in the order of time, no two at one instant."""
    found: list[tuple[int, dict[str, Any]]] = []
    for number in range(draw(st.integers(1, 6))):
        agent, now = draw(st.sampled_from("AAB")), draw(st.integers(0, 20))
        facts = {"agent": agent, "task": f"t{number % 3}", "execution_id": f"e{number}"}
        for kind in draw(st.sampled_from(LEGAL)):
            outcome = draw(st.sampled_from(("succeeded", "failed"))) if kind == "task_ended" else ""
            found.append((now, event(kind, 0, **facts, **({"outcome": outcome} if outcome else {}))))
            now += draw(st.integers(1, 6))
    found.sort(key=lambda one: one[0])
    return frame([event("run_started", 0)] + [row | {"time_ns": at * 10} for at, (_, row) in enumerate(found, 1)])


@settings(max_examples=12)
@given(events=lives(), data=st.data())
def test_at_every_look_the_lanes_are_those_of_all_that_was_told_so_far(
    events: pl.DataFrame, data: st.DataObject
) -> None:
    pieces = batches(events, data.draw(st.lists(st.integers(1, events.height), max_size=4)))
    run = LiveRun(pieces[0])
    parts: list[LivePart] = []
    for number in range(len(pieces)):
        if number:
            run.take(pieces[number])
        now_ns = run.latest_ns + 5
        parts.append(run.part(now_ns, alive=True))
        told = pl.concat(pieces[: number + 1])
        executions, _ = rebuild(told)
        is_open = pl.col("end_ns").is_null()
        until = executions.with_columns(
            pl.when(is_open).then(pl.lit("succeeded")).otherwise("outcome").alias("outcome"),
            pl.when(is_open).then(now_ns).otherwise("end_ns").alias("end_ns"),
            pl.when(is_open).then(now_ns).otherwise("until_ns").alias("until_ns"),
        )
        gaps = live_run_pauses(told, now_ns)
        lanes = said(parts)
        for states in lanes.values():  # what is open has no end in a lane; here it ends now
            states.setdefault(now_ns, "")
        is_same(lanes, execution_lanes(until, gaps, 0), ("done",))
        facts = dict(parts[-1].figures.facts)
        assert facts["executions"] == executions.height
        assert facts["open"] == executions.filter(is_open).height
        assert facts["failed"] == executions.filter(pl.col("outcome") == "failed").height


def live_run_pauses(events: pl.DataFrame, end_ns: int) -> dict[str, list[tuple[int, int, str]]]:
    from hrclog.analyzers.figures.events import pauses

    return pauses(events, end_ns)


def started(agent: str, task: str, at: int, **fields: object) -> dict[str, Any]:
    return event("task_started", at * S, agent=agent, task=task, execution_id=f"{agent}{task}", **fields)


def ended(agent: str, task: str, at: int, **fields: object) -> dict[str, Any]:
    return event("task_ended", at * S, agent=agent, task=task, execution_id=f"{agent}{task}", **fields)


def numbered(rows: list[dict[str, Any]], first: int) -> pl.DataFrame:
    return frame([row | {"seq": first + at} for at, row in enumerate(rows)])


def test_what_is_open_has_no_end_until_it_ends_and_takes_its_true_colours_then() -> None:
    run = LiveRun(frame([event("run_started", 0), started("A", "x", 1)]))
    first = run.part(3 * S, alive=True)
    assert said([first]) == {("A", "done", 0): {1 * S: "x"}}
    again = run.part(9 * S, alive=True)
    assert (again.lanes, again.now_ns) == ({}, 9 * S)
    assert again.rows.frame.is_empty()
    run.take(numbered([ended("A", "x", 10, outcome="failed")], 2))
    last = run.part(10 * S, alive=True)
    assert said([last]) == {("A", "done", 0): {1 * S: "✗ x failed", 10 * S: ""}}
    assert last.rows.frame["outcome"].to_list() == ["failed"]


def test_a_run_whose_recorder_has_gone_shows_what_is_open_up_to_its_last_word_and_goes_on_if_it_wakes() -> None:
    run = LiveRun(frame([event("run_started", 0), started("A", "x", 1), event("heartbeat", 4 * S)]))
    parts = [run.part(7 * S, alive=True), run.part(run.latest_ns, alive=False)]
    assert said(parts)["A", "done", 0] == {1 * S: "x still open", 4 * S: ""}
    assert dict(parts[-1].figures.facts)["outcome"] == "unfinished"
    run.take(numbered([event("heartbeat", 20 * S)], 3))
    parts.append(run.part(run.latest_ns, alive=True))
    assert shown(said(parts)["A", "done", 0], [2 * S, 4 * S, 20 * S]) == ["x", "x", "x"]


def test_the_future_of_a_plan_is_not_told_before_its_time() -> None:
    planned = {"planned_start_ns": 2 * S, "planned_end_ns": 8 * S}
    run = LiveRun(frame([event("run_started", 0), started("A", "x", 1, **planned)]))
    parts = [run.part(now * S, alive=True) for now in (1, 3, 9)]
    lanes = [said([part]).get(("A", "planned", 0)) for part in parts]
    assert lanes == [None, {2 * S: "x"}, {8 * S: ""}]


def test_plans_that_only_rounding_lets_overlap_share_a_lane() -> None:
    rows = [event("run_started", 0)]
    for task, start, end in (("x", 0, S + 300_000), ("y", S, 2 * S)):
        rows.append(started("A", task, len(rows), planned_start_ns=start, planned_end_ns=end))
    lanes = said([LiveRun(frame(rows)).part(5 * S, alive=True)])
    assert lanes["A", "planned", 0] == {0: "x", S + 300_000: "y", 2 * S: ""}


def test_samples_are_drawn_once_and_held_lines_up_to_a_second_ago() -> None:
    safe = event("safety_state_changed", 2 * S, agent="A", mode="slow", speed_scale=0.5)
    run = LiveRun(frame([event("run_started", 0), started("A", "x", 0), started("B", "y", 0), safe]))
    signal = pl.DataFrame([("run", "gap", at * S, float(at)) for at in range(3)], SIGNAL_COLUMNS, orient="row")
    run.take(run_nothing(), signal)
    parts = [run.part(4 * S, alive=True), run.part(6 * S, alive=True)]
    lines = [{one.name: (one.times_ns / S).tolist() for one in part.figures.series} for part in parts]
    assert lines == [
        {"A": [2, 3], "gap": [0, 1, 2], "A and B": [0, 3]},
        {"A": [2, 5], "A and B": [5]},
    ]
    assert [one.name for one in parts[-1].outline.series] == ["A", "gap", "A and B"]


def run_nothing() -> pl.DataFrame:
    return frame([event("heartbeat", 0)]).clear()
