"""Recording what another program writes as JSON lines."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from event_strategies import EVENTS
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.errors import InvalidEventError
from hrclog.event_rows import from_row, to_row
from hrclog.events import Event, TaskFact
from hrclog.log.reader import read_logs
from hrclog.log.writing.journal import journal_path
from hrclog.recorders.sample_lines import Sample
from hrclog.recorders.segments import segment_path
from hrclog.recorders.stdin import Hooks, Refused, record_stream

NOON = 1_772_452_800_000_000_000
RUN_FACTS = ("name", "agents", "plan", "task_properties", "dispatch_mode", "software", "seed", "segment")
TEXT = st.characters(exclude_categories=["Cs"])
JSON_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**53), 2**53) | st.text(TEXT),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(TEXT), inner, max_size=3),
    max_leaves=5,
)


def record(path: Path, lines: list[str]) -> tuple[list[dict[str, Any]], list[Refused]]:
    """Record lines; return the rows between the recorder's own first and last event, and what was refused."""
    seen: list[Event] = []
    recording = record_stream([line(kind="run_started"), *lines], path, hooks=Hooks(on_event=seen.append))
    refused = [Refused(entry.line - 1, entry.reason) for entry in recording.refused]
    [run] = recording.runs
    count = run.n_events
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
    (line(kind="run_started"), "a second time"),
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
    lines = [line(kind="run_ended", outcome="canceled"), line(kind="heartbeat"), line(kind="signal", name="x", value=1)]
    recording = record_stream(lines, path)
    assert (recording.runs[0].n_events, [entry.line for entry in recording.refused]) == (1, [2, 3])
    assert read_logs(path).events["outcome"].to_list() == ["", "canceled"]


@settings(max_examples=40)
@given(st.lists(EVENTS, max_size=5))
def test_any_events_come_through_as_they_are_unless_the_state_machine_refuses_them(
    tmp_path: Path, events: list[Event]
) -> None:
    path = tmp_path / "run.mcap"
    path.unlink(missing_ok=True)
    rows = [to_row(event) | {"run_id": "r"} for event in events]
    lines = [json.dumps({k: v for k, v in row.items() if v is not None}) for row in rows]
    recorded: list[Event] = []
    opening = line(kind="heartbeat", time_ns=0)  # on a clock of its own, any instant may be right
    refused = record_stream([opening, *lines], path, hooks=Hooks(on_event=recorded.append)).refused
    bad = {entry.line for entry in refused}
    # a `run_started` behind task events begins another run
    kept = [event for number, event in enumerate(events, 2) if number not in bad and event.kind != "run_started"]
    ignored = {"run_id": "", "seq": 0}
    assert [to_row(event) | ignored for event in recorded[1:]] == [to_row(event) | ignored for event in kept]
    for entry in refused:
        event = events[entry.line - 2]
        is_known = any(text in entry.reason for text in ("after run_ended", "since 1970"))
        assert isinstance(event, TaskFact) or event.kind == "run_started" or is_known


@settings(max_examples=60)
@given(st.lists(st.text(max_size=40), max_size=4))
def test_any_text_is_refused(tmp_path: Path, lines: list[str]) -> None:
    path = tmp_path / "run.mcap"
    path.unlink(missing_ok=True)
    refused = record_stream([line(kind="heartbeat"), *lines], path).refused
    assert len(refused) == sum(bool(text.strip()) for text in lines)


@pytest.mark.parametrize("times", [(2_000, 1_000), (1_000, 2_000)])
def test_a_run_ends_with_the_latest_of_its_events_in_whatever_order_they_come(
    path: Path, times: tuple[int, int]
) -> None:
    first, second = (line(kind="annotation_added", reason="x", time_ns=at) for at in times)
    record_stream([line(kind="run_started", time_ns=0), first, second], path)
    ends = read_logs(path).events.filter(pl.col("kind") == "run_ended")
    assert ends["time_ns"].to_list() == [2_000]


@pytest.mark.parametrize("blanks", [0, 2])
@pytest.mark.parametrize("opening", [True, False])
def test_a_refused_line_is_named_by_its_number_in_the_input(blanks: int, opening: bool, path: Path) -> None:
    lines = [""] * blanks + [line(kind="run_started", name="a")] * opening
    lines += [line(kind="annotation_added", reason="x"), "nonsense"]
    assert [refused.line for refused in record_stream(lines, path).refused] == [len(lines)]


def started(**fields: object) -> str:
    return line(kind="run_started", time_ns=NOON, **fields)


def execution(agent: str = "robot", task: str = "pick", at_s: int = 1) -> list[str]:
    whose = {"agent": agent, "task": task}
    return [
        line(kind="task_started", time_ns=NOON + at_s * 10**9, **whose),
        line(kind="task_ended", time_ns=NOON + (at_s + 3) * 10**9, **whose),
    ]


def first_event(path: Path) -> dict[str, Any]:
    return read_logs(path).events.sort("seq").row(0, named=True)


@settings(max_examples=20)
@given(st.dictionaries(st.text(TEXT, min_size=1).filter(lambda name: name not in RUN_FACTS), JSON_VALUES, max_size=4))
def test_whatever_details_the_first_line_has_are_in_the_log(tmp_path: Path, details: dict[str, Any]) -> None:
    path = tmp_path / "run.mcap"
    path.unlink(missing_ok=True)
    assert record_stream([started(name="a", agents=["H"], details=details)], path).refused == []
    written = json.loads(first_event(path)["details"])
    assert written == details | {"name": "a", "agents": ["H"]}


FIRST_LINES = [
    '{"kind": "run_started", "name": "a", "time_ns": 5',
    "nonsense",
    "[]",
    line(name="a"),
    line(kind="run_begun", time_ns=5),
    line(kind="run_started", agents=["H", 5], time_ns=5),
    line(kind="run_started", operator="P07", time_ns=5),
    line(kind="run_started", tags=["P07"], time_ns=5),
    line(kind="run_started", tags={"participant": None}, time_ns=5),
    line(kind="task_ended", agent="robot", task="pick", time_ns=5),
    line(kind="task_started", agent="robot", time_ns=5),
    line(kind="signal", name="x", time_ns=5),
]


@pytest.mark.parametrize("bad", FIRST_LINES)
def test_a_bad_first_line_is_refused_and_the_run_begins_with_its_first_event(path: Path, bad: str) -> None:
    recording = record_stream([bad, *execution()], path)
    assert [entry.line for entry in recording.refused] == [1]
    assert (recording.runs[0].n_events, first_event(path)["time_ns"]) == (2, NOON + 10**9)


@pytest.mark.parametrize("bad", FIRST_LINES)
def test_where_no_line_can_be_recorded_nothing_is_written(tmp_path: Path, bad: str) -> None:
    refused: list[Refused] = []
    with pytest.raises(InvalidEventError, match="1 line of which none can be recorded"):
        record_stream([bad], tmp_path / "folder" / "run.mcap", hooks=Hooks(on_refusal=refused.append))
    assert [entry.line for entry in refused] == [1]
    assert list(tmp_path.iterdir()) == []


@settings(max_examples=15)
@given(st.lists(st.booleans(), min_size=1, max_size=4))
def test_every_run_of_a_stream_has_its_log(tmp_path_factory: pytest.TempPathFactory, ended: list[bool]) -> None:
    path = tmp_path_factory.mktemp("runs") / "cell.mcap"
    lines: list[str] = []
    for number, has_end in enumerate(ended):
        end = [line(kind="run_ended", outcome="canceled", time_ns=NOON + 9 * 10**9)] if has_end else []
        lines += [started(name=f"run {number}"), *execution(), *end]
    recording = record_stream(lines, path)
    assert recording.refused == []
    assert [run.path.name for run in recording.runs] == [
        "cell.mcap",
        "cell-run2.mcap",
        "cell-run3.mcap",
        "cell-run4.mcap",
    ][: len(ended)]
    for number, (run, has_end) in enumerate(zip(recording.runs, ended, strict=True)):
        events = read_logs(run.path).events.sort("seq")
        assert json.loads(events["details"][0])["name"] == f"run {number}"
        assert events["kind"].to_list() == ["run_started", "task_started", "task_ended", "run_ended"]
        assert events["outcome"][-1] == ("canceled" if has_end else "succeeded")
        assert events["time_ns"][-1] == NOON + (9 if has_end else 4) * 10**9
        assert events["run_id"].unique().to_list() == [run.run_id]


END = line(kind="run_ended", time_ns=NOON + 9 * 10**9)


@pytest.mark.parametrize("bad", [bad for bad in FIRST_LINES if "task_" not in bad])
def test_a_further_run_whose_first_line_is_bad_loses_no_more_than_that_line(path: Path, bad: str) -> None:
    recording = record_stream([started(name="a"), *execution(), END, bad, *execution(at_s=20)], path)
    assert [entry.line for entry in recording.refused] == [5]
    assert [run.n_events for run in recording.runs] == [3, 2]


def test_stray_lines_after_the_end_of_a_run_begin_none(path: Path) -> None:
    stray = [line(kind="heartbeat", time_ns=NOON), "nonsense", line(kind="heartbeat", time_ns=NOON), execution()[1]]
    recording = record_stream([started(name="a"), *execution(), END, *stray], path)
    assert [entry.line for entry in recording.refused] == [5, 6, 7, 8]
    assert len(recording.runs) == 1


@pytest.mark.parametrize("bad", FIRST_LINES)
def test_a_bad_first_line_does_not_merge_its_run_with_the_next(path: Path, bad: str) -> None:
    recording = record_stream([bad, *execution(), started(name="b"), *execution(at_s=20)], path)
    assert [entry.line for entry in recording.refused] == [1]
    assert [run.n_events for run in recording.runs] == [2, 2]
    assert json.loads(first_event(recording.runs[1].path)["details"])["name"] == "b"


def test_the_same_run_started_begins_another_run_once_there_were_tasks(path: Path) -> None:
    again = started(name="a")
    recording = record_stream([again, again, *execution(), again, *execution(at_s=20)], path)
    assert [(entry.line, "a second time" in entry.reason) for entry in recording.refused] == [(2, True)]
    assert [run.n_events for run in recording.runs] == [2, 2]


@pytest.mark.parametrize("begin", [41, 0])
def test_what_was_lost_of_a_run_is_told_when_it_is_resumed(path: Path, begin: int) -> None:
    record_stream([started(name="a"), *execution()], path)
    journal = journal_path(segment_path(path, 2))
    journal.write_bytes(b"\x89MCAP0\r\n"[: begin and 8] + bytes(3000))
    told: list[str] = []
    recording = record_stream([started(), *execution(at_s=20)], path, resume=True, hooks=Hooks(on_loss=told.append))
    assert recording.losses == tuple(told)
    assert "held no event that can be read" in told[0]
    assert [run.path.name for run in recording.runs] == ["run.2.mcap"]


def test_a_further_run_overwrites_no_log(tmp_path: Path) -> None:
    (tmp_path / "cell-run2.mcap").write_bytes(b"")
    (tmp_path / "cell-run3.mcap.partial").write_bytes(b"")
    runs = record_stream([started(name="a"), started(name="b")], tmp_path / "cell.mcap").runs
    assert [run.path.name for run in runs] == ["cell.mcap", "cell-run4.mcap"]


def test_only_the_first_run_is_resumed(path: Path) -> None:
    record_stream([started(name="a"), *execution()], path)
    runs = record_stream([started(), *execution(at_s=5), started(name="b"), *execution()], path, resume=True).runs
    assert [run.path.name for run in runs] == ["run.2.mcap", "run-run2.mcap"]


@settings(max_examples=25)
@given(st.integers(0, 3_000_000_000), st.sampled_from([10**3, 10**6, 10**9]), st.booleans(), st.booleans())
def test_times_of_another_unit_are_refused_wherever_they_stand(
    tmp_path: Path, seconds: int, factor: int, opened: bool, fraction: bool
) -> None:
    path = tmp_path / "run.mcap"
    path.unlink(missing_ok=True)
    time = (950_000_000 + seconds) * 10**9 // factor
    wrong = line(kind="heartbeat", time_ns=time + 0.5 if fraction else time)
    lines = [*([started()] if opened else []), wrong, line(kind="heartbeat", time_ns=NOON)]
    [refused] = record_stream(lines, path).refused
    unit = {10**9: "seconds", 10**6: "milliseconds", 10**3: "microseconds"}[factor]
    assert refused.line == len(lines) - 1
    assert f"found {unit} since 1970" in refused.reason
    assert "expected nanoseconds" in refused.reason
    assert first_event(path)["time_ns"] == NOON


def test_a_run_on_a_clock_of_its_own_may_pass_any_instant(path: Path) -> None:
    times = [0, 1_780_000_000, 1_780_000_000_000, 1_780_000_000_000_000]
    lines = [line(kind="run_started", time_ns=0), *(line(kind="heartbeat", time_ns=time) for time in times)]
    assert record_stream(lines, path).refused == []


def test_samples_of_signals_are_recorded_between_events(path: Path) -> None:
    sampled: list[Sample] = []
    lines = [
        line(kind="signal", name="distance", value=1, time_ns=NOON),
        *execution(),
        line(kind="signal", values={"distance": 0.5, "force": -2}, time_ns=NOON + 7 * 10**9),
    ]
    recording = record_stream(lines, path, hooks=Hooks(on_sample=sampled.append))
    assert recording.refused == []
    assert (recording.runs[0].n_events, recording.runs[0].n_samples, len(sampled)) == (2, 3, 2)
    logs = read_logs(path, signals=True)
    rows = logs.signals.sort("time_ns", "name").select("name", "value", "time_ns").rows()
    late = NOON + 7 * 10**9
    assert rows == [("distance", 1.0, NOON), ("distance", 0.5, late), ("force", -2.0, late)]
    events = logs.events.sort("seq")
    assert (events["time_ns"][0], events["time_ns"][-1]) == (NOON, late)


@pytest.mark.parametrize(
    "fields",
    [
        {"name": "x"},
        {"value": 1},
        {},
        {"name": "", "value": 1},
        {"name": 5, "value": 1},
        {"name": "\ud800", "value": 1},
        {"name": "x", "value": "1"},
        {"name": "x", "value": True},
        {"name": "x", "value": 10**400},
        {"name": "x", "value": None},
        {"name": "x", "value": 1, "values": {"x": 1}},
        {"values": {}},
        {"values": [1]},
        {"values": {"x": "1"}},
        {"name": "x", "value": 1, "unit": "m"},
        {"name": "x", "value": 1, "time_ns": "now"},
    ],
)
def test_a_sample_that_is_none_is_refused(path: Path, fields: dict[str, object]) -> None:
    recording = record_stream([started(), line(kind="signal", **fields)], path)
    assert [entry.line for entry in recording.refused] == [2]
    assert recording.runs[0].n_samples == 0
