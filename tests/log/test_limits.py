"""Small files that ask for much: each costs little, and the error says which limit was reached and where."""

from __future__ import annotations

import bz2
import gzip
import json
import re
import resource
import sqlite3
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from time import process_time
from typing import Any

import lz4.frame
import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st

from hrclog.log.limits import CHANNELS, LIMITS, UNPACKED, Budget, Limit, LimitError
from hrclog.log.mcap.records import MAGIC
from hrclog.log.mcap.streamed import read_streamed

ROOT = Path(__file__).parents[2]
T0 = 1_780_000_000_000_000_000
MOST_S, MOST_BYTES = 2.0, 400 * 10**6  # twice what is promised, for a busy machine
AS_LIMIT, CPU_LIMIT = 6 * 10**9, 60

CHILD = """
import json, resource, sys, time
from pathlib import Path
import polars, pyarrow, scipy.sparse
from hrclog.analyzers.projections.lints.lints import lint
from hrclog.analyzers.projections.intervals import rebuild
from hrclog.analyzers.projections.overlaps import overlaps
from hrclog.analyzers.projections.runs import runs
from hrclog.errors import HrclogError
from hrclog.log.reader import read_logs

def findings(path):
    try:
        logs = read_logs([path], signals=True)
    except HrclogError as error:
        return [["", str(error), None]]
    executions, illegal = rebuild(logs.events)
    table = runs(logs.events, executions)
    lints = lint(logs.events, executions, overlaps(executions), table)
    return [[found.code, found.message, found.offset] for found in [*logs.diagnostics, *illegal, *lints]][:50]

for name in sys.argv[1:]:
    findings(name) if name == sys.argv[1] else None  # the first time loads modules
    peak, begin = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    found = findings(name)
    rise = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak
    print(json.dumps([name, time.process_time() - begin, rise * 1024, found]), flush=True)
"""


def record(opcode: int, body: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(body)) + body


def text(value: bytes) -> bytes:
    return struct.pack("<I", len(value)) + value


def schema(definition: bytes, number: int = 1, language: bytes = b"ros2msg") -> bytes:
    head = struct.pack("<H", number) + text(b"hrclog_msgs/msg/TaskEvent") + text(language)
    return record(3, head + text(definition))


def channel(number: int, schema_id: int = 1, topic: bytes = b"/hrc/events", encoding: bytes = b"cdr") -> bytes:
    return record(4, struct.pack("<HH", number, schema_id) + text(topic) + text(encoding) + text(b""))


def message(number: int, at: int, data: bytes) -> bytes:
    return record(5, struct.pack("<HIQQ", number, at, T0 + at, T0 + at) + data)


def chunk(records: bytes, name: bytes = b"", stored: bytes | None = None, size: int | None = None) -> bytes:
    body = records if stored is None else stored
    checksum = zlib.crc32(records) if stored is None or records else 0
    head = struct.pack("<QQQI", 0, 0, len(records) if size is None else size, checksum)
    return record(6, head + text(name) + struct.pack("<Q", len(body)) + body)


def packed(records: bytes) -> bytes:
    return chunk(records, b"zstd", zstandard.compress(records))


def log(*parts: bytes) -> bytes:
    head = MAGIC + record(1, text(b"ros2") + text(b"made"))
    return b"".join([head, *parts, record(15, bytes(4)), record(2, bytes(20)), MAGIC])


def defined(definition: bytes, language: bytes = b"ros2msg") -> bytes:
    raw = b"\0\1\0\0" + b"\xff" * 1000
    return log(chunk(schema(definition, language=language) + channel(1) + message(1, 0, raw)))


JSON = channel(1, 0, encoding=b"json")


def events(rows: Iterable[Mapping[str, Any]]) -> bytes:
    return log(packed(JSON + b"".join(message(1, at, json.dumps(row).encode()) for at, row in enumerate(rows))))


def execution(number: int, agent: str, task: str, begin: int, end: int) -> list[dict[str, Any]]:
    row = {"run_id": "r", "agent": agent, "task": task, "execution_id": f"e{number}"}
    return [
        {"kind": "task_started", "time_ns": T0 + begin, "seq": 2 * number, **row},
        {"kind": "task_ended", "time_ns": T0 + end, "seq": 2 * number + 1, "outcome": "succeeded", **row},
    ]


def crowd(n: int, agents: int, tasks: int) -> bytes:
    parts = (execution(i, f"a{i % agents}", f"t{i % tasks}", i, i + 10**9) for i in range(n))
    return events(row for part in parts for row in part)


def zeros(n: int) -> bytes:
    packer = zstandard.ZstdCompressor().compressobj()
    return b"".join([*(packer.compress(bytes(1 << 20)) for _ in range(n >> 20)), packer.flush()])


def fake_heads(size: int, inner: bytes = b"") -> bytes:
    """Return a file of heads of chunks that all reach to its end and fail their checksums."""
    heads, step = bytearray(), 49 + len(inner)
    for at in range(0, size - step, step):
        left = size - at - 9
        heads += struct.pack("<BQQQQIIQ", 6, left, 0, 0, left - 40, 1, 0, left - 40) + inner
    return log()[:33] + b"\0" + bytes(heads) + bytes(size - len(heads))


def ros1(name: bytes, size: int, content: bytes) -> bytes:
    def fields(**values: bytes) -> bytes:
        parts = (key.encode() + b"=" + value for key, value in values.items())
        return b"".join(struct.pack("<I", len(part)) + part for part in parts)

    def entry(head: bytes, body: bytes) -> bytes:
        return struct.pack("<I", len(head)) + head + struct.pack("<I", len(body)) + body

    huge = struct.pack("<I", 2**32 - 1)
    start = entry(fields(op=b"\3", index_pos=bytes(8), conn_count=huge, chunk_count=huge), b" " * 100)
    return b"#ROSBAG V2.0\n" + start + entry(fields(op=b"\5", compression=name, size=struct.pack("<I", size)), content)


def database(path: Path) -> None:
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE topics(id INTEGER, name TEXT, type TEXT, serialization_format TEXT)")
        connection.execute("CREATE TABLE messages(topic_id INTEGER, timestamp INTEGER, data BLOB)")
        rows = [(i, "/hrc/events", "hrclog_msgs/msg/TaskEvent", "cdr") for i in range(5000)]
        connection.executemany("INSERT INTO topics VALUES(?, ?, ?, ?)", rows)


NESTED = b"A[99] a\n" + b"=" * 80 + b"\nMSG: hrclog_msgs/A\nint8[99999] c\n"
DIAMONDS = b"".join(b"T%d x\nT%d y\n%s\nMSG: hrclog_msgs/T%d\n" % (i, i, b"=" * 80, i) for i in range(40)) + b"int8 a\n"
ITSELF = b"T x\n" + b"=" * 80 + b"\nMSG: hrclog_msgs/T\nT[] x\n"
IDL = b"module hrclog_msgs { module msg { %s struct TaskEvent { long x; }; }; };"

HOSTILE: dict[str, tuple[Callable[[], bytes], str]] = {
    # name: what the file holds, and what must be said
    "clean.mcap": (lambda: crowd(4, 2, 2), ""),
    "chunk.mcap": (lambda: log(chunk(b"", b"zstd", zeros(1 << 28), 1 << 28)), "one chunk once unpacked"),
    "chunks.mcap": (lambda: log(chunk(b"", b"zstd", zeros(30 << 20), 30 << 20) * 9), "bytes once unpacked"),
    "lz4.mcap": (lambda: log(chunk(b"", b"lz4", lz4.frame.compress(bytes(1 << 26)), 1 << 26)), "once unpacked"),
    "gzip.mcap": (lambda: gzip.compress(bytes(100 << 20), 1), "once the whole file is unpacked"),
    "zstd.mcap": (lambda: zeros(1 << 29), "once the whole file is unpacked"),
    "twice.mcap": (lambda: gzip.compress(zeros(1 << 29)), "once the whole file is unpacked"),
    "bz2.bag": (lambda: ros1(b"bz2", 100 << 20, bz2.compress(bytes(1 << 20))), "one chunk once unpacked"),
    "details.mcap": (
        lambda: events([{"kind": "run_started", "details": {"x": "A" * (9 << 20)}}]),
        "bytes of one event",
    ),
    "values.mcap": (lambda: events([{"kind": "run_started", "x": [0] * 300_000}]), "values of JSON"),
    "deep.mcap": (lambda: log(chunk(JSON + message(1, 0, b"[" * 10**5))), "JSON within each other"),
    "records.mcap": (lambda: log(packed(record(0x80, b"") * 300_000)), "records in chunks"),
    "frame.mcap": (lambda: log(record(0x80, b"") * 110_000), "records outside of chunks"),
    "metadata.mcap": (lambda: log(record(12, text(b"m") + text(b"")) * 21_000), "different declarations"),
    "channels.mcap": (lambda: log(packed(b"".join(channel(i, 1, b"/t%d" % i) for i in range(5000)))), "4,096"),
    "definition.mcap": (lambda: defined(b"int8 a\n" * 200_000), "characters of one definition"),
    "statements.mcap": (lambda: defined(b"".join(b"int8 a%d\n" % i for i in range(1500))), "statements of one"),
    "lines.mcap": (lambda: defined(b"\n" * 99_000 + b"int8 a\n"), "cannot be decoded"),
    "strings.mcap": (lambda: defined(b"# a\nstring[1000000000] x\n"), "arrays of fixed length"),
    "nested.mcap": (lambda: defined(NESTED), "one message of fixed length"),
    "diamonds.mcap": (lambda: defined(DIAMONDS), "one message of fixed length"),
    "itself.mcap": (lambda: defined(ITSELF), "deep within each other"),
    "parentheses.mcap": (lambda: defined(IDL % b"const long A = ((((1))));", b"ros2idl"), "computes a constant"),
    "shift.mcap": (lambda: defined(IDL % b"const long A = 1 << 99999999;", b"ros2idl"), "computes a constant"),
    "comment.mcap": (lambda: defined(b"/*" * 40_000, b"ros2idl"), "cannot be parsed"),
    "heads.mcap": (lambda: fake_heads(400_000), "the file ends inside a record"),
    "full_heads.mcap": (lambda: fake_heads(1_000_000, message(1, 0, b"")), "checked for being a chunk"),
    "topics.db3": (lambda: b"", "4,097 channels"),
    "tasks.mcap": (lambda: crowd(2000, 2, 2000), "pairs of its executions overlap"),
    "agents.mcap": (lambda: crowd(600, 600, 1), "600 agents"),
}


@pytest.fixture(scope="module")
def costs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[float, int, list[list[Any]]]]:
    """Read every file in one process under limits; return its CPU seconds, bytes and findings."""
    folder = tmp_path_factory.mktemp("hostile")
    for name, (make, _) in HOSTILE.items():
        if name.endswith(".db3"):
            database(folder / name)
        else:
            (folder / name).write_bytes(make())

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (AS_LIMIT, AS_LIMIT))
        resource.setrlimit(resource.RLIMIT_CPU, (CPU_LIMIT, CPU_LIMIT))

    command = [sys.executable, "-c", CHILD, *(str(folder / name) for name in HOSTILE)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, preexec_fn=limit)
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(rows) == len(HOSTILE), done.stderr[-2000:]
    return {Path(name).name: (cpu, rise, findings) for name, cpu, rise, findings in rows}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_file_that_asks_for_much_costs_little_and_says_what_was_too_much(
    costs: dict[str, tuple[float, int, list[list[Any]]]], name: str
) -> None:
    cpu, rise, findings = costs[name]
    assert cpu < MOST_S
    assert rise < MOST_BYTES
    said = HOSTILE[name][1]
    assert any(said in message for _, message, _ in findings) or not said
    assert all(offset is not None for code, _, offset in findings if code == "limit_reached")


def test_what_lies_beside_too_large_a_chunk_is_read() -> None:
    good = chunk(JSON + message(1, 0, b'{"kind": "run_started", "run_id": "r"}'))
    bomb = chunk(b"", b"zstd", zeros(1 << 28), 1 << 28)
    contents = read_streamed(log(bomb, good, bomb))
    assert sum(len(batch.start) for batch in contents.batches) == 1
    begin = len(log()) - 2 * 9 - 24 - len(MAGIC)
    assert [(p.code, p.offset) for p in contents.problems if p.code == "limit_reached"] == [
        ("limit_reached", begin),
        ("limit_reached", begin + len(bomb) + len(good)),
    ]


def test_a_chunk_behind_many_that_only_look_like_one_is_found() -> None:
    good = chunk(JSON + message(1, 0, b'{"kind": "run_started", "run_id": "r"}'))
    contents = read_streamed(fake_heads(200_000) + good)
    assert sum(len(batch.start) for batch in contents.batches) == 1


def least_seconds(data: bytes) -> float:
    """Return the CPU time of reading, the least of some: what disturbs only adds to it."""
    seconds = []
    for _ in range(3):
        begin = process_time()
        read_streamed(data)
        seconds.append(process_time() - begin)
    return min(seconds)


def test_records_that_hide_chunks_take_time_linear_in_their_number() -> None:
    hiding = record(0x90, chunk(JSON))
    few, many = (least_seconds(log(chunk(JSON))[:-45] + hiding * n + b"\x05\xff") for n in (1000, 12_000))
    assert many < 48 * few + 0.3  # twelve times as many: with the square it would be 144


@pytest.mark.slow
@pytest.mark.parametrize("inner", [b"", message(1, 0, b"")])
def test_large_files_of_fake_heads_take_time_linear_in_their_size(inner: bytes) -> None:
    small, large = (least_seconds(fake_heads(size, inner)) for size in (2_000_000, 20_000_000))
    assert large < 40 * small + 0.3  # ten times as large: with the square it would be 100


@given(st.integers(0, 10**12), st.lists(st.integers(0, 10**9), max_size=20))
def test_a_budget_gives_what_the_size_of_the_file_allows_and_no_more(n_bytes: int, amounts: list[int]) -> None:
    budget, spent, most = Budget(n_bytes), 0, UNPACKED.of(n_bytes)
    for amount in amounts:
        if spent + amount <= most:
            budget.spend(UNPACKED, amount)
            spent += amount
        else:
            with pytest.raises(LimitError, match=f"limit reached: {spent + amount:,} bytes once unpacked"):
                budget.spend(UNPACKED, amount)
        assert budget.left(UNPACKED) == most - spent
        assert budget.fresh().left(UNPACKED) == most
        assert budget.left(CHANNELS) == CHANNELS.least


@given(st.sampled_from(LIMITS), st.integers(0, 10**12), st.integers(0, 10**12))
def test_a_larger_file_may_hold_no_less(limit: Limit, first: int, second: int) -> None:
    low, high = sorted((first, second))
    assert limit.least <= limit.of(low) <= limit.of(high) <= limit.most


def test_the_documented_limits_are_those_of_the_code() -> None:
    page = (ROOT / "docs/reliability.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([a-zA-Z ,]+) \| ([\d,]+) \| ([^|]*) \| ([^|]*) \|$", page, re.MULTILINE)
    documented = [(name, least, per_byte.strip(), most.strip()) for name, least, per_byte, most in rows]
    assert documented == [
        (
            limit.name,
            f"{limit.least:,}",
            f"{limit.per_byte:g}" if limit.per_byte else "",
            f"{limit.most:,}" if limit.most < 1 << 62 else "",
        )
        for limit in LIMITS
    ]
