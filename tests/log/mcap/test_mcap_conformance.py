"""The MCAP project's conformance cases: a walk gives the records of the `.json`, an index its messages."""

from __future__ import annotations

import io
import json
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import mcap.records
import pytest
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode

from hrclog.log.mcap.contents import Contents
from hrclog.log.mcap.describe import describe
from hrclog.log.mcap.indexed import read_contents, read_indexed
from hrclog.log.mcap.records import Problem, Walk, expand, parse, record_at
from hrclog.log.mcap.streamed import read_streamed

if TYPE_CHECKING:
    from pathlib import Path

CASES = 416

_NAMES = {opcode: "".join(word.title() for word in opcode.name.split("_")) for opcode in Opcode}
_INDEXED = {"ch", "chx", "mx", "rch", "st"}


@pytest.fixture(scope="module")
def cases(data_dir: Path) -> list[Path]:
    return sorted(data_dir.glob("mcap_conformance/*/*.mcap"))


def test_all_cases_are_there(cases: list[Path]) -> None:
    assert len(cases) == CASES


def test_a_walk_gives_the_expected_records_of_every_case(cases: list[Path]) -> None:
    for case in cases:
        assert _walked(case.read_bytes()) == _expected(case), case.name


def test_a_streamed_read_gives_the_expected_contents_of_every_case(cases: list[Path]) -> None:
    for case in cases:
        contents = read_streamed(case.read_bytes())
        assert (contents.problems, contents.finished) == ([], True), case.name
        assert _contents(contents) == _contents_of_records(_expected(case)), case.name


def test_an_indexed_read_gives_the_expected_contents_of_every_case_that_has_an_index(cases: list[Path]) -> None:
    indexed = [case for case in cases if _features(case) >= _INDEXED and _repeats_schemas(case)]
    assert len(indexed) == 12
    for case in indexed:
        contents = read_indexed(case.read_bytes())
        assert _contents(contents) == _contents_of_records(_expected(case)), case.name


def test_the_statistics_of_the_summary_are_the_expected_ones(cases: list[Path]) -> None:
    counted = [case for case in cases if "st" in _features(case)]
    for case in counted:
        statistics = [fields_ for name, fields_ in _expected(case) if name == "Statistics"]
        stated = describe(case.read_bytes()).statistics or {}
        assert [{name: _value(value) for name, value in stated.items()}] == statistics, case.name
    assert len(counted) == 220


def test_any_read_gives_the_expected_contents_of_every_case(cases: list[Path]) -> None:
    for case in cases:
        contents = read_contents(case.read_bytes())
        assert _contents(contents) == _contents_of_records(_expected(case)), case.name


def _repeats_schemas(case: Path) -> bool:
    return "rsh" in _features(case) or "Schemaless" in case.name


def _features(case: Path) -> set[str]:
    return set(case.stem.split("-")[1:])


def _expected(case: Path) -> list[tuple[str, Any]]:
    records = json.loads(case.with_suffix(".json").read_text())["records"]
    return [(record["type"], dict(record["fields"])) for record in records if record["type"] != "MessageIndex"]


def _walked(data: bytes) -> list[tuple[str, Any]]:
    problems: list[Problem] = []
    found: list[tuple[str, Any]] = []
    for record in Walk(data, problems):
        if record[0] != Opcode.CHUNK:
            found.append(_record(data, record))
            continue
        buffer, position, end = expand(data, record)
        while position < end:
            inner = record_at(buffer, position, end)
            assert inner is not None
            found.append(_record(buffer, inner))
            position = inner[3]
    assert problems == []
    return [entry for entry in found if entry[0] != "MessageIndex"]


def _record(data: bytes, record: tuple[int, int, int, int]) -> tuple[str, Any]:
    name = _NAMES[Opcode(record[0])]
    if name == "Message":
        return name, _plain(_message(data[record[2] : record[3]]))
    return name, _plain(parse(getattr(mcap.records, name), data, record))


def _message(content: bytes) -> mcap.records.Message:
    return mcap.records.Message.read(ReadDataStream(io.BytesIO(content)), len(content))


def _plain(record: object) -> dict[str, Any]:
    return {field.name: _value(getattr(record, field.name)) for field in fields(record)}


def _value(value: object) -> object:
    """Return a value as the `.json` files write it: numbers are texts, bytes lists of them."""
    if isinstance(value, bytes):
        return [str(byte) for byte in value]
    if isinstance(value, dict):
        return {str(key): _value(item) for key, item in value.items()}
    return str(value)


def _contents(contents: Contents) -> dict[str, Any]:
    messages = [
        {"channel_id": str(channel), "sequence": str(sequence), "log_time": str(log), "publish_time": str(publish)}
        | {"data": _value(batch.data[start:end])}
        for batch in contents.batches
        for channel, sequence, log, publish, start, end in zip(
            *(
                getattr(batch, name).tolist()
                for name in ("channel", "sequence", "log_time", "publish_time", "start", "end")
            ),
            strict=True,
        )
    ]
    return {
        "Header": _plain(contents.header),
        "Schema": {str(key): _plain(schema) for key, schema in contents.schemas.items()},
        "Channel": {str(key): _plain(channel) for key, channel in contents.channels.items()},
        "Metadata": [_plain(metadata) for metadata in contents.metadata],
        "Message": messages,
    }


def _contents_of_records(records: list[tuple[str, Any]]) -> dict[str, Any]:
    def of(name: str) -> list[Any]:
        return [content for kind, content in records if kind == name]

    return {
        "Header": of("Header")[0],
        "Schema": {schema["id"]: schema for schema in of("Schema")},
        "Channel": {channel["id"]: channel for channel in of("Channel")},
        "Metadata": of("Metadata"),
        "Message": of("Message"),
    }
