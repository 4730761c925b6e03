"""`hrclog info` describes any MCAP file, ours or not."""

from __future__ import annotations

import gzip
import io
import json
import re
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import ros_bags
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from hrclog.log.mcap.describe import describe
from hrclog.recorders.recorder import Recorder

Run = Callable[..., Any]
Records = dict[str, list[dict[str, Any]]]

CASES = 416
MAGIC = b"\x89MCAP0\r\n"
FOOTER = 9 + 20 + len(MAGIC)


@pytest.fixture(scope="module")
def cases(data_dir: Path) -> list[Path]:
    return sorted(data_dir.glob("mcap_conformance/*/*.mcap"))


def test_info_gives_the_facts_of_every_conformance_case(run: Run, cases: list[Path]) -> None:
    assert len(cases) == CASES
    result = run("info", *cases, "--json")
    assert (result.code, result.err) == (0, "")
    described = result.json()["mcap"]
    assert [facts["path"] for facts in described] == [str(case) for case in cases]
    for case, facts in zip(cases, described, strict=True):
        assert facts == {"path": str(case), **expected_facts(case)}, case.name


def test_the_command_itself_describes_a_conformance_case(cases: list[Path]) -> None:
    case = next(case for case in cases if case.name == "TenMessages-ch-chx-mx-pad-rch-rsh-st-sum.mcap")
    command = [sys.executable, "-m", "hrclog", "info", str(case), "--json"]
    done = subprocess.run(command, capture_output=True, check=True)
    assert json.loads(done.stdout)["mcap"] == [{"path": str(case), **expected_facts(case)}]
    assert done.stderr == b""


def expected_facts(case: Path) -> dict[str, Any]:
    """Return what `info` has to say of a case, from the records that its `.json` lists."""
    records: list[dict[str, Any]] = json.loads(case.with_suffix(".json").read_text())["records"]
    data_end = [record["type"] for record in records].index("DataEnd")
    data, summary = grouped(records[:data_end]), grouped(records[data_end:])
    of_file = grouped(records)
    footer, header = of_file["Footer"][0], of_file["Header"][0]
    messages, times = of_file.get("Message", []), [int(m["log_time"]) for m in of_file.get("Message", [])]
    features = case.stem.split("-")[1:]
    return {
        "profile": header["profile"],
        "library": header["library"],
        "closed": True,
        "n_messages": len(messages),
        "n_unchunked_messages": 0 if "ch" in features else len(messages),
        "start_ns": min(times, default=None),
        "end_ns": max(times, default=None),
        "channels": expected_channels(of_file),
        "schemas": list({schema["id"]: expected_schema(schema) for schema in of_file.get("Schema", [])}.values()),
        "chunks": expected_chunks(case, of_file.get("ChunkIndex", []), features),
        "indexes": {
            "chunk": len(summary.get("ChunkIndex", [])),
            "message": len({message["channel_id"] for message in messages}) if {"ch", "mx"} <= {*features} else 0,
            "attachment": len(summary.get("AttachmentIndex", [])),
            "metadata": len(summary.get("MetadataIndex", [])),
            "summary_offset": len(summary.get("SummaryOffset", [])),
        },
        "summary": {
            "start": int(footer["summary_start"]),
            "offset_start": int(footer["summary_offset_start"]),
            "crc": int(footer["summary_crc"]),
            "n_schemas": len(summary.get("Schema", [])),
            "n_channels": len(summary.get("Channel", [])),
        },
        "data_crc": int(summary["DataEnd"][0]["data_section_crc"]),
        "statistics": next(map(expected_statistics, summary.get("Statistics", [])), None),
        "attachments": expected_attachments(case, data, summary),
        "metadata": expected_metadata(case, data, summary),
        "undeclared_channels": {},
        "other_records": {},
    }


def grouped(records: list[dict[str, Any]]) -> Records:
    groups: Records = {}
    for record in records:
        groups.setdefault(record["type"], []).append(dict(record["fields"]))
    return groups


def expected_schema(schema: dict[str, Any]) -> dict[str, Any]:
    definition = bytes(map(int, schema["data"]))
    names = {"id": int(schema["id"]), "name": schema["name"], "encoding": schema["encoding"]}
    return {**names, "n_bytes": len(definition), "definition": definition.decode()}


def expected_channels(of_file: Records) -> list[dict[str, Any]]:
    schemas = {schema["id"]: schema for schema in of_file.get("Schema", [])}
    counts = Counter(message["channel_id"] for message in of_file.get("Message", []))
    by_id = {channel["id"]: channel for channel in of_file.get("Channel", [])}
    return [
        {
            "id": int(number),
            "topic": channel["topic"],
            "schema_id": int(channel["schema_id"]),
            "schema": schemas.get(channel["schema_id"], {}).get("name"),
            "schema_encoding": schemas.get(channel["schema_id"], {}).get("encoding"),
            "message_encoding": channel["message_encoding"],
            "metadata": channel["metadata"],
            "n_messages": counts[number],
        }
        for number, channel in by_id.items()
    ]


def expected_chunks(case: Path, indexes: list[dict[str, Any]], features: list[str]) -> dict[str, Any]:
    """Return the totals of chunks; a case has one at most, which its file tells where no index does."""
    names = ("", "", 0, 0)
    if indexes:
        assert len(indexes) == 1
        sizes = int(indexes[0]["compressed_size"]), int(indexes[0]["uncompressed_size"])
        names = (indexes[0]["compression"], "chunk", *sizes)
    elif "ch" in features and "NoData" not in case.name and "OneAttachment" not in case.name:
        data = case.read_bytes()
        at = data.index(b"\x06", len(MAGIC) + 9 + int.from_bytes(data[9:17], "little"))
        size = int.from_bytes(data[at + 25 : at + 33], "little")
        names = ("", "chunk", size, size)
    n = int(bool(names[1]))
    return {
        "n": n,
        "n_with_checksum": n,
        "compression": {names[0]: n} if n else {},
        "compressed_bytes": names[2],
        "uncompressed_bytes": names[3],
    }


def expected_statistics(statistics: dict[str, Any]) -> dict[str, Any]:
    counts = {channel: int(n) for channel, n in statistics["channel_message_counts"].items()}
    numbers = {name: int(value) for name, value in statistics.items() if name != "channel_message_counts"}
    return {**numbers, "channel_message_counts": counts}


def expected_attachments(case: Path, data: Records, summary: Records) -> list[dict[str, Any]]:
    places = place_of(case, summary.get("AttachmentIndex", []), 9)
    return [
        {
            "name": attachment["name"],
            "media_type": attachment["media_type"],
            "n_bytes": len(attachment["data"]),
            "log_time_ns": int(attachment["log_time"]),
            "create_time_ns": int(attachment["create_time"]),
            **places,
        }
        for attachment in data.get("Attachment", [])
    ]


def expected_metadata(case: Path, data: Records, summary: Records) -> list[dict[str, Any]]:
    places = place_of(case, summary.get("MetadataIndex", []), 12)
    return [{"name": item["name"], "values": item["metadata"], **places} for item in data.get("Metadata", [])]


def place_of(case: Path, indexes: list[dict[str, Any]], opcode: int) -> dict[str, int]:
    """Return offset and length of the one record of a kind: of its index, or as it stands behind the header."""
    if indexes:
        return {"offset": int(indexes[0]["offset"]), "length": int(indexes[0]["length"])}
    data = case.read_bytes()
    at = len(MAGIC) + 9 + int.from_bytes(data[9:17], "little")
    length = 9 + int.from_bytes(data[at + 1 : at + 9], "little")
    return {"offset": at, "length": length} if data[at] == opcode else {}


Message = tuple[int, int, bytes]


@settings(max_examples=40)
@given(
    st.lists(st.tuples(st.integers(0, 3), st.integers(0, 2**63), st.binary(max_size=40)), max_size=30),
    st.sampled_from([*CompressionType, None]),
    st.sampled_from([IndexType.ALL, IndexType.NONE, IndexType.MESSAGE]),
    st.booleans(),
    st.booleans(),
)
def test_any_file_is_described_as_it_was_written(
    messages: list[Message], compression: CompressionType | None, indexes: IndexType, repeats: bool, statistics: bool
) -> None:
    stream = io.BytesIO()
    writer = Writer(
        stream,
        chunk_size=200,
        compression=compression or CompressionType.NONE,
        index_types=indexes,
        use_chunking=compression is not None,
        use_statistics=statistics,
        repeat_channels=repeats,
        repeat_schemas=repeats,
    )
    writer.start("lab", "a library")
    schema = writer.register_schema("pkg/msg/Type", "ros2msg", b"uint8 x")
    ids = [writer.register_channel(f"/topic/{i}", "cdr", schema if i else 0) for i in range(4)]
    for channel, time, data in messages:
        writer.add_message(ids[channel], time, data, time)
    writer.add_attachment(7, 8, "photo", "image/png", b"x" * 5)
    writer.finish()
    facts = describe(stream.getvalue())
    assert facts is not None
    times = [time for _, time, _ in messages]
    counts = Counter(channel for channel, _, _ in messages)
    assert facts.problems == []
    assert (facts.profile, facts.library, facts.closed) == ("lab", "a library", True)
    assert (facts.n_messages, facts.start_ns) == (len(messages), min(times, default=None))
    assert facts.end_ns == max(times, default=None)
    n_of_topic = {channel.topic: channel.n_messages for channel in facts.channels if channel.n_messages}
    assert n_of_topic == {f"/topic/{i}": n for i, n in counts.items()}
    assert facts.n_unchunked_messages == (len(messages) if compression is None else 0)
    assert [(item.name, item.n_bytes, item.create_time_ns) for item in facts.attachments] == [("photo", 5, 7)]
    assert (facts.statistics is not None) is statistics


def foreign_file(path: Path, *, statistics: bool = True) -> bytes:
    with path.open("wb") as stream:
        writer = Writer(stream, use_statistics=statistics, compression=CompressionType.NONE)
        writer.start("", "someone")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        channel = writer.register_channel("/chatter", "cdr", schema)
        for time in (5, 6, 7):
            writer.add_message(channel, time, b"", time)
        writer.add_metadata("calibration", {"gain": "2"})
        writer.finish()
    return path.read_bytes()


def test_a_file_without_our_events_is_described_and_is_no_failure(run: Run, tmp_path: Path) -> None:
    foreign_file(tmp_path / "foreign.mcap")
    result = run("info", tmp_path / "foreign.mcap")
    assert (result.code, result.err) == (0, "")
    assert "3 messages, 1970-01-01 00:00:00" in result.out
    assert "/chatter  std_msgs/msg/String  cdr" in result.out
    assert "metadata calibration: gain" in result.out
    assert run("check", tmp_path / "foreign.mcap").code == 3


def test_a_file_of_ours_is_described_closed_or_not(run: Run, tmp_path: Path) -> None:
    with Recorder(tmp_path / "run.mcap") as recorder:
        for i in range(3):
            recorder.start("robot", "pick").end()
            recorder.signal("distance", i)
        journal = run("info", tmp_path / "run.mcap.partial", "--json")
    document, unfinished = run("info", tmp_path / "run.mcap", "--json").json(), journal.json()
    events = {file["mcap"][0]["closed"]: file["mcap"][0]["channels"][0] for file in (document, unfinished)}
    assert {closed: (facts["topic"], facts["n_messages"]) for closed, facts in events.items()} == {
        True: ("/hrc/events", 8),
        False: ("/hrc/events", 7),
    }
    assert (document["files"][0]["n_events"], unfinished["files"][0]["n_events"]) == (8, 7)


def test_statistics_that_lie_are_shown_and_not_believed(tmp_path: Path) -> None:
    data = bytearray(foreign_file(tmp_path / "foreign.mcap"))
    footer = len(data) - FOOTER
    data[footer + 25 : footer + 29] = bytes(4)  # no checksum of the summary
    honest = describe(bytes(data))
    assert honest is not None
    assert honest.statistics is not None
    at = bytes(data).rindex((3).to_bytes(8, "little") + (1).to_bytes(2, "little"))
    data[at] = 9
    facts = describe(bytes(data))
    assert facts is not None
    assert facts.statistics == honest.statistics | {"message_count": 9}
    assert (facts.n_messages, facts.channels) == (3, honest.channels)


def test_records_of_unknown_kinds_are_counted(run: Run, tmp_path: Path) -> None:
    data = foreign_file(tmp_path / "foreign.mcap")
    header_end = len(MAGIC) + 9 + int.from_bytes(data[9:17], "little")
    private = b"\x80" + (4).to_bytes(8, "little") + b"mine"
    footer = len(data) - FOOTER
    without_summary = data[:footer] + data[footer : footer + 9] + bytes(20) + MAGIC
    (tmp_path / "private.mcap").write_bytes(without_summary[:header_end] + private * 2 + without_summary[header_end:])
    result = run("info", tmp_path / "private.mcap", "--json")
    facts = result.json()["mcap"][0]
    assert facts["other_records"] == {"128": 2}
    assert facts["n_messages"] == 3


def test_damage_where_no_event_lies_is_told(run: Run, tmp_path: Path) -> None:
    data = foreign_file(tmp_path / "foreign.mcap", statistics=False)
    at = data.index(b"std_msgs/msg/String")
    (tmp_path / "foreign.mcap").write_bytes(data[:at] + b"X" + data[at + 1 :])
    result = run("info", tmp_path / "foreign.mcap")
    assert result.code == 3
    assert "checksum" in result.err


def test_a_bag_folder_is_described_file_by_file(run: Run, data_dir: Path) -> None:
    bag = data_dir.parent / "cases" / "bags" / "good"
    if not bag.is_dir():
        pytest.skip("no bag folder to read")
    described = run("info", bag, "--json").json()["mcap"]
    assert [facts["path"] for facts in described] == [str(bag / "b_0.mcap")]


def stated(recording: dict[str, Any]) -> set[tuple[str, str, int]]:
    return {(topic["topic"], topic["type"], topic["n_messages"]) for topic in recording["topics"]}


def written(path: Path) -> set[tuple[str, str, int]]:
    """Return the topics of a bag as rosbags reads them."""
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        return {(each.topic, each.msgtype, each.msgcount) for each in reader.connections}


SENT = [ros_bags.text(10**18 + n, f"/say/{n % 3}", "x" * n) for n in range(10)]
SENT_1 = [ros_bags.ros1_status(10**18 + n, 10**18 + n, f"/arm/{n % 2}", [("goal", 1)]) for n in range(7)]


@pytest.mark.parametrize(
    "kind", ["mcap", "sqlite", "file.db3", "file.db3.zst", "file.bag", "file.bag.gz", "file.mcap.gz"]
)
def test_topics_types_and_counts_of_any_recording_are_listed(kind: str, run: Run, tmp_path: Path) -> None:
    if kind in ("mcap", "sqlite"):
        bag = expected = ros_bags.write_bag(tmp_path / "bag", SENT, kind)
    else:
        plain, _, packing = kind.removeprefix("file.").partition(".")
        write = {"db3": ros_bags.write_sqlite, "bag": ros_bags.write_ros1, "mcap": ros_bags.write_mcap}[plain]
        bag = expected = write(tmp_path / f"file.{plain}", SENT_1 if plain == "bag" else SENT)
        if packing:
            pack = gzip.compress if packing == "gz" else zstandard.compress
            bag = tmp_path / f"packed.{plain}.{packing}"
            bag.write_bytes(pack(expected.read_bytes()))
    result = run("info", bag, "--json")
    assert (result.code, result.err) == (0, "")
    [recording] = result.json()["recordings"]
    topics = written(expected) if "bag" in kind else of_messages(SENT)
    assert (recording["path"], stated(recording)) == (str(bag), topics)
    assert recording["n_messages"] == sum(n for _, _, n in topics)
    text = run("info", bag)
    assert (text.code, text.err) == (0, "")
    assert all(re.search(rf"^{topic} +{name} +\w+ +{n}$", text.out, re.MULTILINE) for topic, name, n in topics)
    assert f"import it with `hrclog import bag {bag} --suggest`" in text.out


def of_messages(messages: list[ros_bags.Sent]) -> set[tuple[str, str, int]]:
    counts = Counter((sent.topic, sent.kind) for sent in messages)
    return {(*names, n) for names, n in counts.items()}


def test_a_bag_of_many_parts_is_one_table(run: Run, tmp_path: Path) -> None:
    bag = ros_bags.write_bag(tmp_path / "bag", SENT)
    for number in range(1, 5):
        shutil.copy(bag / "bag_0.mcap", bag / f"bag_{number}.mcap")
    result = run("info", bag)
    assert f"{bag}: MCAP, 5 files, 50 messages" in result.out
    assert result.out.count("/say/0 ") == 1
    assert len(run("info", bag, "--json").json()["mcap"]) == 5


def test_a_damaged_database_is_listed_as_far_as_it_can_be_read(run: Run, tmp_path: Path) -> None:
    path = ros_bags.write_sqlite(
        tmp_path / "file.db3", [ros_bags.text(10**18 + n, "/say", "x" * 900) for n in range(50)]
    )
    data = bytearray(path.read_bytes())
    data[8 * 4096 : 8 * 4096 + 8] = b"\xff" * 8
    path.write_bytes(data)
    result = run("info", path, "--json")
    assert result.code == 3
    [(topic, kind, n_messages)] = stated(result.json()["recordings"][0])
    assert (topic, kind, 20 < n_messages < 50) == ("/say", "std_msgs/msg/String", True)


def test_samples_of_bags_are_listed_as_another_reader_does(run: Run, data_dir: Path) -> None:
    folder = data_dir.parent / "samples"
    if not folder.is_dir():
        pytest.skip("no samples to read")
    for bag in (folder / "ros1" / "bench_a.bag", folder / "ros1" / "bench_b.bag", folder / "ros2" / "plansys2_humble"):
        [recording] = run("info", bag, "--json").json()["recordings"]
        assert stated(recording) == written(bag)


def test_a_log_of_ours_needs_no_import(run: Run, samples: Path) -> None:
    result = run("info", samples / "single.mcap")
    assert "import it" not in result.out
    many = run("info", samples / "campaign")
    assert "--json lists all" in many.out
