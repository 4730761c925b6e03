"""Whole records that are removed, doubled, swapped, put in or spliced: the same facts, or an error."""

from __future__ import annotations

import random
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any, Final

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer

from hrclog.diagnostic import Diagnostic, loses_data
from hrclog.errors import LogReadError
from hrclog.events import Event, RunEnded, RunStarted, TaskEnded, TaskStarted
from hrclog.log.decode import is_event_channel
from hrclog.log.encode import FloatSignal, JointSignal, Message, Signal, event_message, run_metadata, signal_message
from hrclog.log.indexed import read_contents, read_indexed
from hrclog.log.journal import LIBRARY, Journal
from hrclog.log.reader import read_log, read_logs
from hrclog.log.records import Walk
from hrclog.log.streamed import read_streamed
from hrclog.log.writer import RUN_METADATA

N_TASKS: Final = 20
CHUNK_SIZE: Final = 1500


def messages_of(run_id: str, value: float, start_ns: int) -> list[Message]:
    """Return a run's events, and behind them its signals."""
    events: list[Event] = [RunStarted(time_ns=start_ns, run_id=run_id, name="run")]
    for i in range(N_TASKS):
        at, who = start_ns + 10 * i, {"agent": "robot", "task": f"pick {i % 5}", "execution_id": f"{run_id}-{i:02}"}
        events += [
            TaskStarted(time_ns=at + 1, run_id=run_id, **who),
            TaskEnded(time_ns=at + 6, run_id=run_id, outcome="succeeded", **who),
        ]
    events.append(RunEnded(time_ns=start_ns + 1000, run_id=run_id))
    signals: list[Signal] = [FloatSignal(run_id, "distance", start_ns + i, value + i) for i in range(40)]
    signals += [JointSignal(run_id, "robot", start_ns + i, ("a", "b"), (value, i)) for i in range(40)]
    return [
        *(event_message(replace(event, seq=seq), event.time_ns) for seq, event in enumerate(events)),
        *(signal_message(signal, signal.time_ns) for signal in signals),
    ]


def closed_log(run_id: str, compression: CompressionType, *, value: float = 0.5, crcs: bool = True, at: int = 0) -> bytes:
    """Return a closed log, as hrclog writes them."""
    stream = BytesIO()
    writer = Writer(stream, CHUNK_SIZE, compression, enable_crcs=crcs, enable_data_crcs=crcs)
    writer.start("ros2", LIBRARY)
    ids: dict[str, int] = {}
    for message in messages_of(run_id, value, at):
        spec = message.channel
        if spec.topic not in ids:
            schema = writer.register_schema(spec.type_name, "ros2msg", spec.definition)
            ids[spec.topic] = writer.register_channel(spec.topic, "cdr", schema, dict(spec.metadata))
        times = message.log_time, message.data, message.publish_time, message.sequence
        writer.add_message(ids[spec.topic], *times)
    writer.add_metadata(RUN_METADATA, run_metadata(RunStarted(run_id=run_id, time_ns=0, name="run")))
    writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it untyped
    return stream.getvalue()


def journal_log(folder: Path, run_id: str, start_ns: int) -> bytes:
    """Return a journal, as a killed recorder leaves it: events and samples in turns."""
    journal = Journal(folder / f"{run_id}.mcap.partial")
    messages = messages_of(run_id, 0.5, start_ns)
    events = [message for message in messages if message.channel.topic == "/hrc/events"]
    samples = messages[len(events) :]
    journal.append(events[0])
    journal.metadata(RUN_METADATA, run_metadata(RunStarted(run_id=run_id, time_ns=0, name="run")))
    for event, *pair in zip(events[1:], samples[::2], samples[1::2], strict=False):
        journal.append(event)
        journal.append(*pair)
    journal.close()
    return journal.path.read_bytes()


@dataclass(frozen=True)
class Pair:
    """A file, another one whose records are put into it, and how both are named."""

    name: str
    data: bytes
    other: bytes

    @property
    def records(self) -> list[bytes]:
        return parts(self.data)


def parts(data: bytes) -> list[bytes]:
    """Return a file in pieces: magic bytes, records, magic bytes."""
    problems: list[Any] = []
    records = [data[offset:end] for _, offset, _, end in Walk(data, problems)]
    assert not problems
    tail = len(data) - 8 - sum(map(len, records))
    return [data[:8], *records, *([data[-tail:]] if tail else [])]


Mutation = Callable[[list[bytes], list[bytes], int, int], list[bytes]]

MUTATIONS: dict[str, Mutation] = {
    "remove": lambda own, other, i, j: own[:i] + own[i + 1 :],
    "remove some": lambda own, other, i, j: own[: min(i, j)] + own[max(i, j) :],
    "double": lambda own, other, i, j: [*own[: i + 1], own[i], *own[i + 1 :]],
    "double elsewhere": lambda own, other, i, j: [*own[:j], own[i], *own[j:]],
    "swap": lambda own, other, i, j: [own[{i: j, j: i}.get(k, k)] for k in range(len(own))],
    "insert": lambda own, other, i, j: [*own[:i], other[j % len(other)], *own[i:]],
    "replace": lambda own, other, i, j: [*own[:i], other[i % len(other)], *own[i + 1 :]],
    "splice": lambda own, other, i, j: own[:i] + other[i:],
    "splice anywhere": lambda own, other, i, j: own[:i] + other[j % len(other) :],
}


def facts(path: Path, data: bytes) -> tuple[object, list[Diagnostic]]:
    path.write_bytes(data)
    logs = read_logs(path, signals=True)
    events = logs.events.drop("path", "log_time_ns")
    return (events.rows(), logs.signals.rows()), logs.diagnostics
