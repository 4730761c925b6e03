"""What reading says of events that cannot be right, and what it makes of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from hrclog.event_rows import to_row
from hrclog.events import LATEST_NS, Heartbeat, RunStarted, TaskStarted
from hrclog.log.logs import Logs
from hrclog.log.messages.channels import EVENTS as EVENTS_CHANNEL
from hrclog.log.messages.encode import Message
from hrclog.log.messages.message import encode_row
from hrclog.log.reader import read_logs
from hrclog.log.writing.writer import write_atomically, write_log


def write_rows(path: Path, *rows: dict[str, Any]) -> Path:
    """Write rows as they are, as another program might."""

    def fill(writer: Any) -> None:  # noqa: ANN401 - a FinishedWriter
        for row in rows:
            writer.add(Message(EVENTS_CHANNEL, 1, 1, encode_row(row)))

    write_atomically(path, fill)
    return path


def row(seq: int, **values: object) -> dict[str, Any]:
    event = TaskStarted(time_ns=5, seq=seq, run_id="r", agent="R", task="pick", execution_id=f"e{seq}")
    return to_row(event) | values


def found(logs: Logs, code: str) -> list[int | None]:
    return [finding.seq for finding in logs.diagnostics if finding.code == code]


@pytest.mark.parametrize("instant", [LATEST_NS + 1, -LATEST_NS - 1, 2**63 - 1])
def test_an_event_at_an_impossible_instant_is_skipped_and_said(instant: int, tmp_path: Path) -> None:
    logs = read_logs(write_rows(tmp_path / "a.mcap", row(0), row(1, time_ns=instant), row(2)))
    assert logs.events["seq"].to_list() == [0, 2]
    assert found(logs, "invalid_time") == [1]


@pytest.mark.parametrize(
    ("name", "value", "unset"),
    [
        ("speed_scale", 1.5, None),
        ("speed_scale", -0.1, None),
        ("planned_start_ns", -(2**63) + 1, None),
        ("agent_time_ns", 2**62, None),
        ("role", "aux", "primary"),
    ],
)
def test_a_value_outside_its_range_counts_as_unset_and_is_said(
    name: str, value: object, unset: object, tmp_path: Path
) -> None:
    logs = read_logs(write_rows(tmp_path / "a.mcap", row(0), row(1, **{name: value})))
    assert logs.events[name].to_list()[1] == unset
    assert found(logs, "invalid_value") == [1]


@pytest.mark.parametrize("value", [0.0, 1.0, None])
def test_values_in_their_range_are_left_alone(value: float | None, tmp_path: Path) -> None:
    logs = read_logs(write_rows(tmp_path / "a.mcap", row(0), row(1, speed_scale=value, role="auxiliary")))
    assert logs.events["speed_scale"].to_list()[1] == value
    assert logs.events["role"].to_list()[1] == "auxiliary"
    assert logs.diagnostics == []


def test_two_runs_of_one_id_are_an_error_and_two_segments_are_not(tmp_path: Path) -> None:
    for number, segment in enumerate((1, 1, 2)):
        started = RunStarted(time_ns=number, run_id="r", name=f"run {number}", segment=segment)
        write_log(tmp_path / f"{number}.mcap", [started, Heartbeat(time_ns=9 + number, run_id="r")])
    assert found(read_logs([tmp_path / "0.mcap", tmp_path / "2.mcap"]), "conflicting_runs") == []
    logs = read_logs(tmp_path)
    assert len(found(logs, "conflicting_runs")) == 1
    assert logs.events.height == 6


def test_the_answer_does_not_depend_on_the_order_of_the_files(tmp_path: Path) -> None:
    write_rows(tmp_path / "a.mcap", row(0), row(2))
    write_rows(tmp_path / "b.mcap", row(0), row(7, kind="novel"))
    (tmp_path / "c.mcap").write_text("nonsense")
    paths = [tmp_path / name for name in ("a.mcap", "b.mcap", "c.mcap")]
    first, second = read_logs(paths), read_logs(paths[::-1])
    assert first.diagnostics == second.diagnostics
    assert first.events.equals(second.events)
