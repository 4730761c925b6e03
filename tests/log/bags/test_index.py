"""Of large bags only what is wanted is read: by the index of a closed ROS 1 bag, and of an MCAP file that is mapped."""

from __future__ import annotations

from pathlib import Path

import pytest
import ros_bags as bags
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.records import Channel, Schema
from sizes import many

from hrclog.log.files.mapped import map_file
from hrclog.log.mcap.contents import Contents
from hrclog.log.parts import read_part

T = 1_700_000_000_000_000_000
Asked = list[tuple[str, int, int]]


def status(number: int, topic: str, size: int) -> bags.Sent:
    at = T + number * 10**6
    return bags.ros1_status(at, at, topic, [("x" * size, 1)])


def wanted(channel: Channel, schema: Schema | None) -> bool:  # noqa: ARG001 - both are given
    return channel.topic.startswith("/a")


def told(contents: Contents) -> list[tuple[str, int, bytes]]:
    return [
        (contents.channels[channel].topic, time, batch.data[start:end])
        for batch in contents.batches
        for channel, time, start, end in zip(
            *(array.tolist() for array in (batch.channel, batch.log_time, batch.start, batch.end)), strict=True
        )
        if contents.channels[channel].topic.startswith("/a")
    ]


@settings(max_examples=many(15, fuzz=300))
@given(
    drawn=st.lists(st.tuples(st.sampled_from(["/a", "/a/b", "/camera"]), st.integers(0, 4000)), min_size=1, max_size=30)
)
@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_what_is_wanted_is_read_whether_a_file_is_mapped_or_not(
    kind: str, drawn: list[tuple[str, int]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("bags") / f"b.{kind}"
    messages = [status(number, topic, size) for number, (topic, size) in enumerate(drawn)]
    if kind == "bag":
        bags.write_ros1(path, messages)
    else:
        kilted = [bags.text(sent.time_ns, sent.topic, "x" * len(sent.data)) for sent in messages]
        bags.write_mcap(path, kilted, chunk_size=3000)
    complaints: list[str] = []
    whole = read_part(path, wanted, lambda code, *_: complaints.append(code))
    mapped = read_part(path, wanted, lambda code, *_: complaints.append(code), mapped=True)
    assert told(mapped) == told(whole)
    assert mapped.topics() == whole.topics()
    assert complaints == (["unprotected", "unprotected"] if kind == "bag" else [])


def test_chunks_without_anything_wanted_are_not_looked_into(tmp_path: Path) -> None:
    camera = [status(number, "/camera", 5000) for number in range(20)]
    path = bags.write_ros1(tmp_path / "b.bag", [status(0, "/a", 9), *camera])
    data = path.read_bytes()
    start = data.rindex(b"x" * 5000)
    torn = data[: start - 60] + b"\xff" * 60 + data[start:]  # the head of a record inside of a chunk
    path.write_bytes(torn)  # in the last chunk
    complaints: list[str] = []
    contents = read_part(path, wanted, lambda code, *_: complaints.append(code), mapped=True)
    assert [row[0] for row in told(contents)] == ["/a/status"]
    assert complaints == ["unprotected"]
    assert contents.topics()["/camera/status", "actionlib_msgs/msg/GoalStatusArray"] == 20


@given(st.binary(max_size=50), st.binary(max_size=4), st.integers(0, 60))
def test_a_mapped_file_is_as_its_bytes(tmp_path: Path, data: bytes, part: bytes, at: int) -> None:
    path = tmp_path / "x"
    path.write_bytes(data)
    mapped = map_file(path)
    assert mapped[:] == data
    assert mapped.startswith(part) == data.startswith(part)
    assert mapped.endswith(part) == data.endswith(part)
    assert mapped.startswith(data[at : at + 3], at) == data.startswith(data[at : at + 3], at) or at > len(data)


def test_images_beside_wanted_messages_are_not_kept(tmp_path: Path) -> None:
    image = bags.text(T, "/camera", "x" * (1 << 20))
    messages = [bags.text(T + number, "/a", str(number)) for number in range(50)]
    path = bags.write_mcap(tmp_path / "b.mcap", [image, *messages], chunk_size=1 << 22)
    contents = read_part(path, wanted, lambda *_: None, mapped=True)
    assert sum(len(batch.data) for batch in contents.batches) < 5000
    assert [row[1] for row in told(contents)] == [T + number for number in range(50)]
