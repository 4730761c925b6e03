"""MCAP to an events frame: ours beside generic decoders."""

from __future__ import annotations

import struct
import sys
import tempfile
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from measure import cpu_seconds, table

from hrclog.events import STRING_COLUMNS, Event, RunEnded, RunStarted, TaskEnded, TaskStarted
from hrclog.ids import new_id
from hrclog.log.one_log import read_log
from hrclog.log.writing.writer import write_log


def make_log(path: Path, executions: int) -> int:
    """Write a log of that many executions and return its number of events."""
    run = new_id()
    events: list[Event] = [RunStarted(time_ns=0, run_id=run, name="benchmark", agents=("human", "robot"))]
    for number in range(executions):
        agent, task = ("human", "pick_white_box") if number % 2 else ("robot", "pick_orange_box")
        fact = {"run_id": run, "agent": agent, "task": task, "execution_id": new_id(), "task_type": "pick"}
        events.append(TaskStarted(time_ns=number * 1000, planned_start_ns=number * 1000, **fact))
        events.append(TaskEnded(time_ns=number * 1000 + 1500, planning_time_s=0.2, path_length=2.4, **fact))
    events.sort(key=lambda event: event.time_ns)
    write_log(path, [*events, RunEnded(time_ns=executions * 1000 + 2000, run_id=run)])
    return 2 * executions + 2


def with_mcap_ros2(path: Path) -> int:
    """Decode with mcap and mcap-ros2-support, the usual way."""
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return len([message for _, _, _, message in reader.iter_decoded_messages(topics=["/hrc/events"])])


def by_hand(path: Path) -> int:
    """Decode with mcap and a loop of struct calls written for this one message."""
    fixed = struct.Struct("<IIq4q4d")
    rows = []
    with path.open("rb") as stream:
        for _, _, message in make_reader(stream, validate_crcs=True).iter_messages(topics=["/hrc/events"]):
            data = message.data
            row, at = list(fixed.unpack_from(data, 4)), 4 + fixed.size
            for _ in STRING_COLUMNS:
                at += -(at - 4) % 4
                size = int.from_bytes(data[at : at + 4], "little")
                row.append(data[at + 4 : at + 3 + size].decode())
                at += 4 + size
            rows.append(row)
    return len(rows)


def main(executions: int) -> None:
    """Print the comparison."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.mcap"
        events = make_log(path, executions)
        rows = [
            ("hrclog", cpu_seconds(lambda: read_log(path))),
            ("mcap + struct by hand", cpu_seconds(lambda: by_hand(path), 1)),
            ("mcap + mcap-ros2-support", cpu_seconds(lambda: with_mcap_ros2(path), 1)),
        ]
        print(f"{events} events, {path.stat().st_size / events:.0f} bytes each\n")
        print(table(rows, "reader", events))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100_000)
