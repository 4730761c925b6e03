"""Recording what another program writes as JSON lines."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from event_strategies import EVENTS
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog import Recorder
from hrclog.event_rows import from_row, to_row
from hrclog.events import Event, TaskFact
from hrclog.log.reader import read_logs
from hrclog.recorders.stdin import Refused, record_lines, record_stream


def record(path: Path, lines: list[str]) -> tuple[list[dict[str, Any]], list[Refused]]:
    """Record lines; return the rows between the recorder's own first and last event, and what was refused."""
    seen: list[Event] = []
    with Recorder(path) as recorder:
        count, refused, _ = record_lines(lines, recorder, seen.append)
    assert count == len(seen)
    events = read_logs(path).events.sort("seq")
    assert events["seq"].to_list() == list(range(events.height))
    assert [from_row(row) for row in events.slice(1, count).iter_rows(named=True)] == seen
    return events.slice(1, events.height - 2).rows(named=True), refused


def line(**fields: object) -> str:
    return json.dumps(fields)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


def test_a_task_needs_no_more_than_kind_agent_and_task(path: Path) -> None:
    rows, refused = record(
        path,
        [
            line(kind="task_started", agent="robot", task="pick"),
            line(kind="task_paused", agent="robot", task="pick", cause="safety"),
            line(kind="task_resumed", agent="robot", task="pick"),
            "",
            "   \n",
            line(kind="task_ended", agent="robot", task="pick") + "\n",
        ],
    )
    assert refused == []
    assert [row["kind"] for row in rows] == ["task_started", "task_paused", "task_resumed", "task_ended"]
    assert len({row["execution_id"] for row in rows}) == 1
    assert [row["time_ns"] for row in rows] == sorted(row["time_ns"] for row in rows)
    assert {(row["role"], row["attempt"]) for row in rows} == {("primary", 1)}
    assert rows[-1]["outcome"] == "succeeded"


def test_given_times_ids_and_details_are_kept_and_run_and_seq_are_the_recorders(path: Path) -> None:
    rows, refused = record(
        path,
        [
            line(kind="task_started", agent="robot", task="pick", execution_id="e", time_ns=5, seq=77, run_id="other"),
            line(kind="task_ended", agent="robot", task="pick", execution_id="e", time_ns=9, outcome="failed",
                 details={"force": [1, 2]}, path_length=2),
        ],
    )  # fmt: skip
    assert refused == []
    assert [(row["execution_id"], row["time_ns"]) for row in rows] == [("e", 5), ("e", 9)]
    assert (rows[1]["outcome"], rows[1]["details"], rows[1]["path_length"]) == ("failed", '{"force":[1,2]}', 2.0)
    assert "other" not in {row["run_id"] for row in rows}


def test_tasks_of_one_name_run_side_by_side_by_their_ids(path: Path) -> None:
    both = {"agent": "robot", "task": "pick"}
    rows, refused = record(
        path,
        [
            line(kind="task_started", **both, execution_id="a"),
            line(kind="task_started", **both, execution_id="b"),
            line(kind="task_ended", **both),
            line(kind="task_ended", **both, execution_id="b"),
            line(kind="task_ended", **both),
        ],
    )
    assert [(entry.line, "found 2 open executions" in entry.reason) for entry in refused] == [(3, True)]
    assert [row["execution_id"] for row in rows] == ["a", "b", "b", "a"]


BAD = [
    ("{", "found no JSON"),
    ("[1]", "found a JSON list"),
    ("[" * 100_000, "found no JSON"),
    ("{}", "found an object without `kind`"),
    (line(kind="task_started", agent="robot"), "task is empty"),
    (line(kind="task_started", agent=5, task="pick"), "agent is 5, expected a text"),
    (line(kind="task_started", agent="\ud800", task="pick"), "expected valid Unicode"),
    (
        line(kind="task_started", agent="robot", task="pick", time_ns=1.7e18),
        "time_ns is 1.7e\\+18, expected an integer",
    ),
    (line(kind="task_started", agent="robot", task="pick", details="[]"), "expected a JSON object"),
    (line(kind="task_started", agent="robot", task="pick", details={"x": float("nan")}), "cannot be written as JSON"),
    (line(kind="task_ended", agent="robot", task="pick"), "found 0 open executions"),
    (line(kind="task_ended", agent="robot", task="pick", execution_id="e"), "end_without_start"),
    (line(kind="run_ended", outcome="ok"), "outcome is 'ok', expected one of succeeded"),
    (line(kind="task_teleported"), "kind is 'task_teleported', expected one of the vocabulary"),
    (line(kind="run_started"), "after the run began"),
    (line(kind="safety_state_changed", speed_scale=-1), "speed_scale is -1"),
]


@pytest.mark.parametrize(("bad", "reason"), BAD)
def test_a_line_that_cannot_be_recorded_is_refused_with_its_number_and_the_others_are_recorded(
    path: Path, bad: str, reason: str
) -> None:
    rows, refused = record(path, [line(kind="heartbeat"), bad, line(kind="heartbeat")])
    assert [row["kind"] for row in rows] == ["heartbeat", "heartbeat"]
    assert [entry.line for entry in refused] == [2]
    assert re.search(reason, refused[0].reason)


def test_nothing_follows_the_end_of_a_run(path: Path) -> None:
    with Recorder(path) as recorder:
        lines = [line(kind="run_ended", outcome="canceled"), line(kind="heartbeat")]
        count, refused, _ = record_lines(lines, recorder)
    assert (count, [entry.line for entry in refused]) == (1, [2])
    assert read_logs(path).events["outcome"].to_list() == ["", "canceled"]


@settings(max_examples=40)
@given(st.lists(EVENTS, max_size=5))
def test_any_events_come_through_as_they_are_unless_the_state_machine_refuses_them(
    tmp_path: Path, events: list[Event]
) -> None:
    path = tmp_path / "run.mcap"
    path.unlink(missing_ok=True)
    lines = [json.dumps({k: v for k, v in to_row(event).items() if v is not None}) for event in events]
    with Recorder(path) as recorder:
        recorded: list[Event] = []
        _, refused, _ = record_lines(lines, recorder, recorded.append)
    kept = [event for number, event in enumerate(events, 1) if number not in {entry.line for entry in refused}]
    ignored = {"run_id": "", "seq": 0}
    assert [to_row(event) | ignored for event in recorded] == [to_row(event) | ignored for event in kept]
    for entry in refused:
        event = events[entry.line - 1]
        assert isinstance(event, TaskFact) or event.kind == "run_started" or "after run_ended" in entry.reason


@settings(max_examples=60)
@given(st.lists(st.text(max_size=40), max_size=4))
def test_any_text_is_recorded_or_refused(tmp_path: Path, lines: list[str]) -> None:
    path = tmp_path / "run.mcap"
    path.unlink(missing_ok=True)
    with Recorder(path) as recorder:
        count, refused, _ = record_lines(lines, recorder)
    assert count + len(refused) == sum(bool(text.strip()) for text in lines)


def test_a_run_ends_with_the_latest_of_its_events_in_whatever_order_they_come(path: Path) -> None:
    late, early = (line(kind="annotation_added", reason="x", time_ns=at) for at in (2_000, 1_000))
    with Recorder(path, time_ns=0) as recorder:
        assert record_lines([late, early], recorder)[2] == 2_000
        assert record_lines([early, late], recorder)[2] == 2_000


@pytest.mark.parametrize("blanks", [0, 2])
@pytest.mark.parametrize("opening", [True, False])
def test_a_refused_line_is_named_by_its_number_in_the_input(blanks: int, opening: bool, path: Path) -> None:
    lines = [""] * blanks + [line(kind="run_started", name="a")] * opening
    lines += [line(kind="annotation_added", reason="x"), "nonsense"]
    assert [refused.line for refused in record_stream(lines, path).refused] == [len(lines)]
