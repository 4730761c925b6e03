"""Bags as recorders, kills and copies leave them: a folder never gives less than the files in it."""

from __future__ import annotations

import bz2
import gzip
import json
import shutil
import sqlite3
import struct
import tracemalloc
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from time import process_time

import lz4.frame
import polars as pl
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from hrclog.errors import LogReadError
from hrclog.event_rows import to_row
from hrclog.events import Event, RunEnded, RunStarted, TaskEnded, TaskStarted
from hrclog.log.bags.folder import open_bag
from hrclog.log.logs import Logs
from hrclog.log.messages.message import DEFINITION, TYPE_NAME, encode_row
from hrclog.log.reader import read_logs

T0 = 1_700_000_000 * 10**9
MILLISECOND = 10**6


def recording(n_executions: int = 6, run_id: str = "r", begin: int = T0, *, whole: bool = True) -> list[Event]:
    """Return a run of two agents whose executions overlap; without its first and last event if it is not whole."""
    events: list[Event] = []
    for i in range(n_executions):
        agent, start = ("robot", "human")[i % 2], begin + 10 * i * MILLISECOND
        fact = {"run_id": run_id, "agent": agent, "task": f"{agent} task", "execution_id": f"{begin}-{i}"}
        events.append(TaskStarted(time_ns=start, **fact))
        events.append(TaskEnded(time_ns=start + 15 * MILLISECOND, **fact, outcome="succeeded"))
    events.sort(key=lambda event: event.time_ns)
    if whole:
        first = RunStarted(time_ns=begin - 1, run_id=run_id, agents=("human", "robot"))
        events = [first, *events, RunEnded(time_ns=begin + 10**9, run_id=run_id, outcome="succeeded")]
    return [replace(event, seq=seq) for seq, event in enumerate(events)]


RUN = recording()


@cache
def store() -> Typestore:
    types = get_typestore(Stores.LATEST)
    types.register(get_types_from_msg(DEFINITION, TYPE_NAME))
    return types


def write_part(path: Path, events: Sequence[Event], *foreign: tuple[str, str, str, bytes, bytes]) -> Path:
    """Write a part as rosbag2 does: uncompressed chunks, an index.

    Args:
        path: the file.
        events: its events.
        foreign: other topics, each with one message: topic, type, encoding and text of the definition, message.
    """
    path.parent.mkdir(exist_ok=True)
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=1000, compression=CompressionType.NONE)
        writer.start(profile="ros2")
        for topic, kind, language, definition, message in foreign:
            other = writer.register_channel(topic, "cdr", writer.register_schema(kind, language, definition))
            writer.add_message(other, T0, message, T0, 1)
        schema = writer.register_schema(TYPE_NAME, "ros2msg", DEFINITION.encode())
        channel = writer.register_channel("/hrc/events", "cdr", schema)
        for event in events:
            writer.add_message(channel, event.time_ns, encode_row(to_row(event)), event.time_ns)
        writer.finish()
    return path


def write_metadata(bag: Path, names: Sequence[str]) -> None:
    files = "".join(f"    - {name}\n" for name in names)
    text = f"rosbag2_bagfile_information:\n  version: 8\n  storage_identifier: mcap\n  relative_file_paths:\n{files}"
    (bag / "metadata.yaml").write_text(f"{text}  files:\n    - path: {names[0]}\n", encoding="utf-8")


def write_bag(bag: Path, *parts: Sequence[Event]) -> Path:
    paths = [write_part(bag / f"{bag.name}_{number}.mcap", events) for number, events in enumerate(parts)]
    write_metadata(bag, [path.name for path in paths])
    return bag


def facts(logs: Logs) -> pl.DataFrame:
    return logs.events.drop("path", "log_time_ns")


def codes(logs: Logs) -> list[str]:
    return [diagnostic.code for diagnostic in logs.diagnostics]


@pytest.fixture
def whole(tmp_path: Path) -> pl.DataFrame:
    """Return the events of `RUN` as a single file gives them."""
    return facts(read_logs(write_part(tmp_path / "whole" / "run.mcap", RUN)))


# metadata.yaml is a hint


def _versioned(text: str) -> str:
    return text.replace("version: 8", "version: 99").replace("mcap\n", '""\n', 1)


METADATA: dict[str, Callable[[str], str]] = {
    "as it is": lambda text: text,
    "empty": lambda _: "",
    "no YAML": lambda _: "a: [b: {c\x00\xff",
    "another document": lambda _: "name: my robot\nversion: 3\n",
    "of a newer version, without a storage id": _versioned,
    "torn in a name": lambda text: text[: text.index("bag_1") + 3],
    "torn behind a name": lambda text: text[: text.index("bag_1.mcap") + 10],
    "lists fewer files": lambda text: text.replace("    - bag_1.mcap\n", ""),
    "in one line": lambda text: text.replace(
        "\n    - bag_0.mcap\n    - bag_1.mcap\n", " ['bag_0.mcap', \"old/bag_1.mcap\"]\n"
    ),
    "from Windows": lambda text: text.replace("\n", "\r\n"),
    "lists the files as compressed": lambda text: text.replace("_1.mcap", "_1.mcap.zstd"),
}


@pytest.mark.parametrize("name", METADATA)
def test_all_parts_of_a_folder_are_read_whatever_its_metadata_say(
    tmp_path: Path, whole: pl.DataFrame, name: str
) -> None:
    bag = write_bag(tmp_path / "bag", RUN[:6], RUN[6:])
    metadata = bag / "metadata.yaml"
    metadata.write_bytes(METADATA[name](metadata.read_text()).encode(errors="replace"))
    logs = read_logs(bag)
    assert logs.diagnostics == []
    assert facts(logs).equals(whole)
    assert logs.paths == [bag]


def test_a_folder_without_metadata_gives_what_its_files_give(tmp_path: Path, whole: pl.DataFrame) -> None:
    bag = write_bag(tmp_path / "bag", RUN[:6], RUN[6:])
    (bag / "metadata.yaml").unlink()
    logs = read_logs(bag)
    assert logs.diagnostics == []
    assert facts(logs).equals(whole)


@pytest.mark.parametrize("style", ["{}", "'{}'", "old_folder/{}"])
def test_a_part_that_is_listed_and_missing_is_named(tmp_path: Path, style: str) -> None:
    bag = write_bag(tmp_path / "bag", RUN[:6])
    write_metadata(bag, [style.format(name) for name in ("bag_0.mcap", "bag_1.mcap", "bag_2.db3")])
    logs = read_logs(bag)
    assert logs.events.height == 6
    assert [(found.code, found.path) for found in logs.diagnostics] == [
        ("missing_part", str(bag / "bag_1.mcap")),
        ("missing_part", str(bag / "bag_2.db3")),
    ]


def test_a_folder_none_of_whose_parts_is_there_is_refused_with_their_names(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", RUN)
    (bag / "bag_0.mcap").unlink()
    with pytest.raises(LogReadError, match=r"no part of a bag \(it lists bag_0\.mcap\)"):
        read_logs(bag)


# damage costs a part and no more


@settings(max_examples=25)
@given(st.integers(0, 4000), st.integers(0, 2))
def test_a_torn_part_costs_only_its_own_events_and_is_named(tmp_path: Path, cut: int, torn: int) -> None:
    bag = write_bag(tmp_path / "bag", RUN[:5], RUN[5:10], RUN[10:])
    part = bag / f"bag_{torn}.mcap"
    part.write_bytes(part.read_bytes()[:cut])
    logs = read_logs(bag)
    kept = [event.seq for number, events in enumerate((RUN[:5], RUN[5:10], RUN[10:])) for event in events]
    lost = {event.seq for event in (RUN[:5], RUN[5:10], RUN[10:])[torn]}
    assert set(kept) - lost <= set(logs.events["seq"].to_list())
    assert {found.path for found in logs.diagnostics if found.code in ("truncated", "no_header")} == {str(part)}
    (own,) = (found for found in logs.diagnostics if found.code in ("truncated", "no_header"))
    assert "byte" in own.message or "0 events" in own.message or "footer" in own.message


def test_a_part_of_another_kind_costs_only_itself_and_says_how_much(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", RUN, [])
    (bag / "bag_1.mcap").write_bytes(b"PNG" * 100)
    logs = read_logs(bag)
    assert logs.events.height == len(RUN)
    (only,) = logs.diagnostics
    assert (only.code, only.path) == ("unreadable_file", str(bag / "bag_1.mcap"))
    assert only.message.endswith("none of its 300 bytes were read")


def test_a_bag_none_of_whose_parts_can_be_read_is_refused(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", RUN, [])
    for number in (0, 1):
        (bag / f"bag_{number}.mcap").write_bytes(b"PNG" * 100)
    with pytest.raises(LogReadError, match=r"none of whose 2 parts can be read, the first: .*bag_0\.mcap"):
        read_logs(bag)


# topics of others


FOREIGN = {
    "a service": (b"ros2msg", b"int8 code\n---\nbool fine\n"),
    "not known": (b"unknown", b""),
    "an action": (
        b"ros2msg",
        b"=" * 80 + b"\nACTION: pick/action/Pick\nint8 goal\n---\nint8 result\n---\nint8 feedback\n",
    ),
    "no text at all": (b"ros2idl", b"\xff\xfe{{{"),
    "another version of a type that we use": (b"ros2msg", b"string data\nint8 further\n"),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_the_definition_of_another_topic_is_never_parsed(tmp_path: Path, whole: pl.DataFrame, name: str) -> None:
    language, definition = FOREIGN[name]
    other = ("/pick/_action/feedback", "std_msgs/msg/String", language.decode(), definition, b"\0\1\0\0junk")
    write_part(tmp_path / "bag" / "bag_0.mcap", RUN, other)
    write_metadata(tmp_path / "bag", ["bag_0.mcap"])
    logs = read_logs(tmp_path / "bag", signals=True)
    assert logs.diagnostics == []
    assert facts(logs).equals(whole)


def test_each_channel_is_decoded_by_its_own_definition(tmp_path: Path, whole: pl.DataFrame) -> None:
    lines = [line.split("#")[0].strip() for line in DEFINITION.splitlines() if line.split("#")[0].strip()]
    swapped = list(lines)
    agent, task = lines.index("string agent"), lines.index("string task")
    swapped[agent], swapped[task] = swapped[task], swapped[agent]
    path = tmp_path / "bag" / "bag_0.mcap"
    path.parent.mkdir()
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        for part, layout in ((RUN[:7], swapped), (RUN[7:], lines)):
            schema = writer.register_schema(TYPE_NAME, "ros2msg", "\n".join(layout).encode())
            channel = writer.register_channel("/hrc/events", "cdr", schema)
            for event in part:
                row = to_row(event)
                if layout is swapped:
                    row = row | {"agent": row["task"], "task": row["agent"]}
                writer.add_message(channel, event.time_ns, encode_row(row), event.time_ns)
        writer.finish()
    write_metadata(path.parent, [path.name])
    logs = read_logs(path.parent)
    assert logs.diagnostics == []
    assert facts(logs).equals(whole)


def test_a_bag_without_our_events_is_told_its_topics(tmp_path: Path) -> None:
    chatter = ("/chatter", "std_msgs/msg/String", "ros2msg", b"string data", b"\0\1\0\0\2\0\0\0a\0")
    status = ("/pick/_action/status", "action_msgs/msg/GoalStatusArray", "unknown", b"", b"\0\1\0\0")
    write_part(tmp_path / "bag" / "bag_0.mcap", [], chatter)
    write_part(tmp_path / "bag" / "bag_1.mcap", [], chatter, status)
    write_metadata(tmp_path / "bag", ["bag_0.mcap", "bag_1.mcap"])
    (only,) = read_logs(tmp_path / "bag").diagnostics
    assert only.code == "no_events"
    assert "/chatter (std_msgs/msg/String, 2 messages)" in only.message
    assert "/pick/_action/status (action_msgs/msg/GoalStatusArray, 1 message)" in only.message


# SQLite


def write_database(bag: Path, events: Sequence[Event], **options: object) -> Path:
    """Write a bag of one SQLite part with rosbags."""
    with Writer2(bag, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        if options:
            writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
        chatter = writer.add_connection("/chatter", "std_msgs/msg/String", typestore=store())
        connection = writer.add_connection("/hrc/events", TYPE_NAME, typestore=store())
        for event in events:
            writer.write(chatter, event.time_ns, b"\0\1\0\0\2\0\0\0a\0")
            writer.write(connection, event.time_ns, encode_row(to_row(event)))
    return bag / f"{bag.name}.db3"


def test_a_lone_sqlite_part_is_read_alone_in_its_folder_and_compressed(tmp_path: Path, whole: pl.DataFrame) -> None:
    part = write_database(tmp_path / "bag", RUN)
    (part.parent / "metadata.yaml").unlink()
    packed = tmp_path / "part.db3.zstd"
    packed.write_bytes(zstandard.compress(part.read_bytes()))
    for path in (part, part.parent, packed):
        logs = read_logs(path)
        assert [found.code for found in logs.diagnostics] == ["unprotected"]
        assert facts(logs).equals(whole)
    assert list(part.parent.iterdir()) == [part]


def test_an_unfinished_journal_of_sqlite_is_taken_into_account_and_left_alone(
    tmp_path: Path, whole: pl.DataFrame
) -> None:
    part = write_database(tmp_path / "bag", RUN)
    killed = tmp_path / "killed"
    killed.mkdir()
    with closing(sqlite3.connect(part)) as database:
        database.execute("PRAGMA journal_mode = WAL")
        database.execute("UPDATE messages SET timestamp = timestamp + 1")
        database.commit()
        for name in ("bag.db3", "bag.db3-wal"):
            shutil.copyfile(part.parent / name, killed / name)
    before = {path.name: path.read_bytes() for path in killed.iterdir()}
    logs = read_logs(killed)
    assert [found.code for found in logs.diagnostics] == ["unprotected"]
    assert facts(logs).equals(whole)
    assert set(logs.events["log_time_ns"].to_list()) == {event.time_ns + 1 for event in RUN}
    assert {path.name: path.read_bytes() for path in killed.iterdir()} == before


def test_an_sqlite_part_that_breaks_off_gives_what_is_left_of_it(tmp_path: Path) -> None:
    events = recording(400)
    part = write_database(tmp_path / "bag", events)
    data = part.read_bytes()
    part.write_bytes(data[: len(data) * 3 // 4])
    logs = read_logs(part.parent)
    assert 100 < logs.events.height < len(events)
    found = [found for found in logs.diagnostics if found.code == "truncated"]
    assert [found.path for found in found] == [str(part)]
    assert f"of its {len(data):,} bytes are missing" in found[0].message


@pytest.mark.parametrize("share", [0.3, 0.5, 0.8])
def test_a_zeroed_page_of_sqlite_costs_what_lies_in_it_and_is_counted(tmp_path: Path, share: float) -> None:
    events = recording(400)
    part = write_database(tmp_path / "bag", events)
    data = bytearray(part.read_bytes())
    page = int(len(data) * share) // 4096 * 4096
    data[page : page + 4096] = bytes(4096)
    part.write_bytes(data)
    logs = read_logs(part.parent)
    n_lost = len(events) - logs.events.height
    assert 0 < n_lost < 40
    assert {events[0].seq, events[-1].seq} <= set(logs.events["seq"])
    (damage,) = (found for found in logs.diagnostics if found.code == "corrupt_data")
    n_rows = int(damage.message.split(": ")[1].split(" rows of all topics cannot be read in 1 place")[0])
    assert n_lost <= n_rows <= 2 * n_lost + 1  # every second row is of another topic


def test_messages_of_sqlite_without_numbers_are_numbered_through_the_parts(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    for number, part in enumerate((RUN[:6], RUN[6:])):
        with Writer2(tmp_path / f"one_{number}", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
            connection = writer.add_connection("/hrc/events", "std_msgs/msg/String", typestore=store())
            for event in part:
                row = {name: value for name, value in to_row(event).items() if value not in ("", None)}
                text = json.dumps({**row, "seq": None, "run_id": ""}).encode() + b"\0"
                writer.write(connection, event.time_ns, b"\0\1\0\0" + struct.pack("<I", len(text)) + text)
        bag.mkdir(exist_ok=True)
        shutil.copyfile(tmp_path / f"one_{number}" / f"one_{number}.db3", bag / f"bag_{number}.db3")
    write_metadata(bag, ["bag_0.db3", "bag_1.db3"])
    logs = read_logs(bag)
    assert codes(logs) == ["unprotected"] * 2 + ["no_run_id"]
    assert logs.events["run_id"].n_unique() == 1
    assert logs.events["seq"].to_list() == list(range(len(RUN)))


# compression


@pytest.mark.parametrize("plugin", list(StoragePlugin))
@pytest.mark.parametrize("mode", [CompressionMode.MESSAGE, CompressionMode.FILE])
@pytest.mark.parametrize("with_metadata", [True, False])
def test_a_compressed_bag_gives_equal_events_also_without_metadata(
    tmp_path: Path, whole: pl.DataFrame, plugin: StoragePlugin, mode: CompressionMode, *, with_metadata: bool
) -> None:
    writer = Writer2(tmp_path / "bag", version=9, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/hrc/events", TYPE_NAME, typestore=store())
        for event in RUN:
            writer.write(connection, event.time_ns, encode_row(to_row(event)))
    if not with_metadata:
        (tmp_path / "bag" / "metadata.yaml").unlink()
    logs = read_logs(tmp_path / "bag")
    assert {found.code for found in logs.diagnostics} <= {"unprotected"}  # as rosbags writes MCAP
    assert facts(logs).equals(whole)


PACKERS: dict[str, Callable[[bytes], bytes]] = {
    "run.mcap.gz": gzip.compress,
    "run.mcap.zstd": zstandard.compress,
    "run.mcap.zst": lambda data: b"".join(map(zstandard.compress, (data[:700], data[700:]))),
    "run.mcap": lambda data: gzip.compress(data[:99]) + gzip.compress(data[99:]) + bytes(512),
    "twice.mcap.gz": lambda data: gzip.compress(zstandard.compress(data)),
}


@pytest.mark.parametrize("name", PACKERS)
def test_a_compressed_file_gives_equal_events_whatever_its_name(tmp_path: Path, whole: pl.DataFrame, name: str) -> None:
    source = write_part(tmp_path / "source" / "run.mcap", RUN)
    folder = tmp_path / "packed"
    folder.mkdir()
    (folder / name).write_bytes(PACKERS[name](source.read_bytes()))
    for path in (folder / name, folder):
        logs = read_logs(path)
        assert logs.diagnostics == []
        assert facts(logs).equals(whole)


@pytest.mark.parametrize("pack", [gzip.compress, zstandard.compress])
@settings(max_examples=25)
@given(share=st.floats(0.3, 0.999), flip=st.booleans())
def test_a_damaged_compressed_file_gives_a_part_and_a_complaint_or_is_refused(
    tmp_path: Path, pack: Callable[[bytes], bytes], *, share: float, flip: bool
) -> None:
    source = write_part(tmp_path / "source" / "run.mcap", RUN)
    data = bytearray(pack(source.read_bytes()))
    at = int(len(data) * share)
    if flip:
        data[at] ^= 0x55
    path = tmp_path / "run.mcap.gz"
    path.write_bytes(data if flip else data[:at])
    try:
        logs = read_logs(path)
    except LogReadError as error:
        assert "cannot be unpacked" in str(error)  # noqa: PT017 - either outcome is right
        return
    is_whole = facts(logs).height == len(RUN)
    assert is_whole or {"truncated", "corrupt_data", "events_missing"} & set(codes(logs))


def test_what_unpacks_to_gigabytes_is_refused(tmp_path: Path) -> None:
    packer = zstandard.ZstdCompressor().compressobj()
    path = tmp_path / "bomb.mcap.zstd"
    path.write_bytes(b"".join(packer.compress(bytes(1 << 20)) for _ in range(200)) + packer.flush())
    with pytest.raises(LogReadError, match=r"bytes that unpack to more than 33,554,432 bytes"):
        read_logs(path)
    message = zstandard.compress(bytes(40 << 20))
    with (tmp_path / "messages.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema(TYPE_NAME, "ros2msg", DEFINITION.encode())
        channel = writer.register_channel("/hrc/events", "cdr", schema)
        for _ in range(20):
            writer.add_message(channel, T0, message, T0)
        writer.finish()
    tracemalloc.start()
    logs = read_logs(tmp_path / "messages.mcap")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert set(codes(logs)) == {"undecodable_event"}
    assert peak < 500 << 20


@pytest.mark.parametrize("pack", [bz2.compress, lz4.frame.compress])
def test_another_compression_is_named(tmp_path: Path, pack: Callable[[bytes], bytes]) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(pack(write_part(tmp_path / "source" / "run.mcap", RUN).read_bytes()))
    with pytest.raises(LogReadError, match=r"a compressed file or archive.*unpack it first"):
        read_logs(path)


# ROS 1


def write_ros1(path: Path, events: Sequence[Event], compression: Writer1.CompressionFormat | None = None) -> Path:
    writer = Writer1(path)
    writer.chunk_threshold = 2000
    if compression is not None:
        writer.set_compression(compression)
    with writer:
        odd = writer.add_connection("/odd", "pick/msg/Pick", msgdef="this is --- no definition", md5sum="0" * 32)
        connection = writer.add_connection("/hrc/events", TYPE_NAME, typestore=store())
        for event in events:
            raw = bytes(store().cdr_to_ros1(encode_row(to_row(event)), TYPE_NAME))
            writer.write(connection, event.time_ns, raw)
            writer.write(odd, event.time_ns, b"junk")
    return path


@pytest.mark.parametrize("compression", [None, *Writer1.CompressionFormat])
def test_a_ros_1_bag_gives_equal_events_also_beside_topics_that_cannot_be_parsed(
    tmp_path: Path, whole: pl.DataFrame, compression: Writer1.CompressionFormat | None
) -> None:
    logs = read_logs(write_ros1(tmp_path / "run.bag", RUN, compression))
    is_bz2 = compression is Writer1.CompressionFormat.BZ2  # which has a checksum of its own
    assert [found.code for found in logs.diagnostics] == ([] if is_bz2 else ["unprotected"])
    assert facts(logs).equals(whole)


def test_a_ros_1_bag_of_json_texts_gives_equal_events(tmp_path: Path, whole: pl.DataFrame) -> None:
    with Writer1(tmp_path / "run.bag") as writer:
        connection = writer.add_connection("/cell/hrc/events", "std_msgs/msg/String", typestore=store())
        for event in RUN:
            row = {name: value for name, value in to_row(event).items() if value is not None}
            text = json.dumps(row).encode()
            writer.write(connection, event.time_ns, struct.pack("<I", len(text)) + text)
    logs = read_logs(tmp_path / "run.bag")
    assert [found.code for found in logs.diagnostics] == ["unprotected"]
    assert facts(logs).equals(whole)


def unclosed(data: bytes) -> bytes:
    """Return a ROS 1 bag as a kill leaves it: no index, and its header says so."""
    index_at = struct.unpack_from("<Q", data, data.index(b"index_pos=") + 10)[0]
    head = data.replace(b"index_pos=" + struct.pack("<Q", index_at), b"index_pos=" + bytes(8), 1)
    return head[:index_at]


@settings(max_examples=25)
@given(st.integers(0, 3000))
def test_a_ros_1_bag_that_was_not_closed_gives_what_is_whole_and_says_so(tmp_path: Path, cut: int) -> None:
    data = unclosed(write_ros1(tmp_path / "run.bag", RUN).read_bytes())
    (tmp_path / "run.bag").unlink()
    path = tmp_path / "killed.bag.active"
    path.write_bytes(data[: len(data) - cut])
    logs = read_logs(tmp_path)
    assert logs.events.height == len(RUN) or cut
    assert logs.events.height
    (first, *_) = logs.diagnostics
    assert (first.code, first.path) == ("truncated", str(path))
    assert "was not closed" in first.message
    assert "rosbag reindex" in first.message


def test_messages_behind_a_chunk_that_was_being_written_are_read(tmp_path: Path, whole: pl.DataFrame) -> None:
    data = unclosed(write_ros1(tmp_path / "run.bag", RUN).read_bytes())
    last = data.rindex(b"compression=none")
    at = data.index(b"size=", last) + 9  # behind the header: how long the chunk is
    path = tmp_path / "killed.bag.active"
    path.write_bytes(data[:at] + bytes(4) + data[at + 4 :])
    logs = read_logs(path)
    assert facts(logs).equals(whole)


def test_a_ros_1_bag_of_another_version_is_named(tmp_path: Path) -> None:
    path = tmp_path / "old.bag"
    path.write_bytes(b"#ROSBAG V1.2\n" + bytes(100))
    with pytest.raises(LogReadError, match=r"a ROS 1 bag of another version \(b'#ROSBAG V1\.2'\)"):
        read_logs(path)


# any damage


WRITERS: dict[str, Callable[[Path], Path]] = {
    "SQLite": lambda folder: write_database(folder / "bag", RUN),
    "ROS 1": lambda folder: write_ros1(folder / "run.bag", RUN, Writer1.CompressionFormat.BZ2),
    "MCAP": lambda folder: write_part(folder / "bag" / "run.mcap", RUN),
}


@pytest.mark.parametrize("name", WRITERS)
@settings(max_examples=40)
@given(st.data())
def test_no_damage_raises_anything_but_a_typed_error(tmp_path: Path, name: str, data: st.DataObject) -> None:
    folder = tmp_path / "source"
    if not folder.exists():
        folder.mkdir()
        shutil.copyfile(WRITERS[name](folder), tmp_path / "sound")
    content = bytearray((tmp_path / "sound").read_bytes())
    for _ in range(data.draw(st.integers(1, 3))):
        begin = data.draw(st.integers(0, len(content) - 1))
        content[begin : begin + data.draw(st.integers(0, 100))] = data.draw(st.binary(max_size=100))
    path = tmp_path / "damaged"
    path.write_bytes(content)
    with suppress(LogReadError):
        read_logs(path, signals=True)


# recordings without run ids


def nameless(events: Sequence[Event]) -> list[Event]:
    return [replace(event, run_id="") for event in events]


def cut_at(events: list[Event], cuts: Sequence[int]) -> list[list[Event]]:
    places = sorted({cut % len(events) for cut in cuts} - {0})
    return [events[begin:end] for begin, end in zip([0, *places], [*places, len(events)], strict=True)]


@settings(max_examples=20)
@given(st.lists(st.integers(1, 100), max_size=4), st.booleans())
def test_a_recording_split_into_files_of_a_folder_is_one_run(tmp_path: Path, cuts: list[int], whole: bool) -> None:
    events = nameless(recording(8, whole=whole))
    folder = tmp_path / "split"
    shutil.rmtree(folder, ignore_errors=True)
    parts = cut_at(events, cuts)
    for number, part in enumerate(parts):
        write_part(folder / f"b_{number}.mcap", part)
    logs = read_logs(folder)
    assert logs.events["run_id"].n_unique() == 1
    assert logs.events["seq"].to_list() == list(range(len(events)))
    assert codes(logs) == ["no_run_id"]
    assert f"{len(events)} events name no run" in logs.diagnostics[0].message
    assert {Path(path).name for path in logs.events["path"]} == {f"b_{number}.mcap" for number in range(len(parts))}


@settings(max_examples=20)
@given(st.lists(st.integers(1, 100), max_size=3), st.integers(0, 10), st.booleans())
def test_two_recordings_that_each_begin_anew_stay_two_runs(
    tmp_path: Path, cuts: list[int], later: int, whole: bool
) -> None:
    folder = tmp_path / "split"
    shutil.rmtree(folder, ignore_errors=True)
    for name, begin in (("a", T0), ("b", T0 + later * 20 * MILLISECOND + 1)):
        for number, part in enumerate(cut_at(nameless(recording(8, begin=begin, whole=whole)), cuts)):
            write_part(folder / f"{name}_{number}.mcap", part)
    logs = read_logs(folder)
    assert codes(logs) == ["no_run_id"] * 2
    counts = logs.events.group_by("run_id").agg(pl.col("seq").n_unique(), pl.len())
    assert counts.select("seq", "len").rows() == [(18, 18) if whole else (16, 16)] * 2


def test_open_executions_join_files_whose_events_carry_no_numbers(tmp_path: Path) -> None:
    events = [replace(event, seq=0) for event in nameless(recording(6, whole=False))]
    write_part(tmp_path / "split" / "b_0.mcap", events[:5])
    write_part(tmp_path / "split" / "b_1.mcap", events[5:])
    assert read_logs(tmp_path / "split").events["run_id"].n_unique() == 1


def test_files_in_different_folders_are_never_joined(tmp_path: Path) -> None:
    events = nameless(RUN)
    first = write_part(tmp_path / "a" / "b_0.mcap", events[:6])
    second = write_part(tmp_path / "b" / "b_1.mcap", events[6:])
    assert read_logs([first, second]).events["run_id"].n_unique() == 2


def test_the_parts_of_a_bag_are_one_run_until_a_run_begins_anew(tmp_path: Path) -> None:
    first = nameless(RUN)
    second = nameless(recording(begin=T0 + 10**10))
    logs = read_logs(write_bag(tmp_path / "bag", first[:6], first[6:], second[:5], second[5:]))
    assert codes(logs) == ["no_run_id"] * 2
    assert sorted(logs.events.group_by("run_id").len()["len"]) == [len(first), len(second)]


def test_a_run_begins_anew_in_a_bag_also_where_events_carry_no_numbers(tmp_path: Path) -> None:
    first, second = ([replace(event, seq=0) for event in nameless(recording(begin=T0 + i))] for i in (0, 10**10))
    logs = read_logs(write_bag(tmp_path / "bag", first, second))
    assert logs.events["run_id"].n_unique() == 2


def test_a_part_without_events_gives_its_signals_to_the_run_of_the_bag(tmp_path: Path) -> None:
    signal = ("/hrc/signals/speed", "std_msgs/msg/Float64", "ros2msg", b"float64 data", b"\0\1\0\0" + bytes(8))
    write_part(tmp_path / "bag" / "bag_0.mcap", RUN)
    write_part(tmp_path / "bag" / "bag_1.mcap", [], signal)
    write_metadata(tmp_path / "bag", ["bag_0.mcap", "bag_1.mcap"])
    logs = read_logs(tmp_path / "bag", signals=True)
    assert logs.diagnostics == []
    assert logs.signals.rows() == [("r", "speed", T0, 0.0)]


@pytest.mark.parametrize(
    "text",
    ["\n" * 10**6, "relative_file_paths:" + " " * 10**6, "relative_file_paths: [\n" * 40_000, "- a" + " " * 10**6],
)
def test_a_hostile_metadata_file_is_read_in_linear_time(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.mcap").write_bytes(b"")
    (tmp_path / "metadata.yaml").write_text(text)
    begin = process_time()
    open_bag(tmp_path)
    assert process_time() - begin < 2
