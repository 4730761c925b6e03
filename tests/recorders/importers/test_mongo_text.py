"""Every layout in which a dump may come, and dumps that are cut off or broken."""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.errors import ImportDataError
from hrclog.recorders.importers.mongo_text import plain_value, read_dump

TEXT = st.text(st.characters(exclude_categories=["Cs"]) | st.sampled_from('\u2028\u2029\x85\x0b\x0c\n{}[],"\\'))
DOCUMENTS = st.lists(
    st.dictionaries(TEXT, TEXT | st.integers() | st.lists(st.fixed_dictionaries({"a": TEXT}), max_size=2), max_size=3),
    min_size=2,
    max_size=4,
)


def lines(documents: list[Any]) -> str:
    return "\n".join(json.dumps(document, ensure_ascii=False) for document in documents)


LAYOUTS: dict[str, Callable[[list[Any]], str]] = {
    "array": lambda documents: json.dumps(documents, ensure_ascii=False),
    "indented array": lambda documents: json.dumps(documents, indent=2),
    "array of lines": lambda documents: "[" + ",\n".join(map(json.dumps, documents)) + "]\n",
    "lines": lines,
    "lines of another system": lambda documents: lines(documents).replace("\n", "\r\n") + "\r\n",
    "indented": lambda documents: "\n".join(json.dumps(document, indent=2) for document in documents),
    "indented with tabs": lambda documents: "\n".join(json.dumps(document, indent="\t") for document in documents),
    "one behind the other": lambda documents: "".join(map(json.dumps, documents)),
    "arrays": lambda documents: "\n".join(json.dumps([document]) for document in documents),
    "byte order mark": lambda documents: "\ufeff" + json.dumps(documents),
}
PACKINGS: dict[str, Callable[[bytes], bytes]] = {
    "plain": lambda data: data,
    "gzip": gzip.compress,
    "zstd": zstandard.compress,
}


@pytest.mark.parametrize("packing", PACKINGS)
@pytest.mark.parametrize("layout", LAYOUTS)
@settings(max_examples=10)
@given(documents=DOCUMENTS)
def test_every_layout_gives_the_same_documents(
    layout: str, packing: str, tmp_path: Path, documents: list[dict[str, Any]]
) -> None:
    source = tmp_path / "dump.json"
    source.write_bytes(PACKINGS[packing](LAYOUTS[layout](documents).encode()))
    dump = read_dump(source)
    assert (dump.values, dump.diagnostics) == (documents, [])


@pytest.mark.parametrize("layout", ["array", "indented array", "array of lines", "lines", "indented"])
@given(data=st.data(), names=st.lists(TEXT, min_size=2, max_size=4))
def test_a_dump_that_is_cut_gives_the_rows_before_the_cut_and_names_its_line(
    layout: str, tmp_path: Path, data: st.DataObject, names: list[str]
) -> None:
    documents = [{"name": name, "inner": {"number": 7}} for name in names]
    whole = LAYOUTS[layout](documents).encode()
    first = whole.index(b"}}" if "indented" not in layout else b"}\n", whole.index(b"inner")) + 8
    cut = data.draw(st.integers(min(first, len(whole) - 2), len(whole) - 2))
    source = tmp_path / "dump.json"
    source.write_bytes(whole[:cut])
    dump = read_dump(source)
    assert dump.values == documents[: len(dump.values)]
    if layout in ("lines", "indented") and len(dump.values) == len(documents):
        return
    if dump.diagnostics or layout not in ("lines", "indented"):  # between two rows of these nothing shows a cut
        [told] = dump.diagnostics
        assert told.code == "truncated"
        assert told.message.startswith("line ")
        assert f"{len(dump.values)} row" in told.message


@pytest.mark.parametrize("layout", ["lines", "indented", "array of lines"])
def test_a_broken_row_costs_itself_alone(layout: str, tmp_path: Path) -> None:
    documents = [{"name": name} for name in "abc"]
    source = tmp_path / "dump.json"
    source.write_text(LAYOUTS[layout](documents).replace('"b"', "b"))
    dump = read_dump(source)
    assert dump.values == [documents[0], documents[2]]
    assert [told.code for told in dump.diagnostics] == ["skipped_row"]
    assert dump.diagnostics[0].message.startswith("line 4: " if layout == "indented" else "line 2: ")


@pytest.mark.parametrize("packing", ["gzip", "zstd"])
def test_compression_that_is_cut_off_gives_the_rows_before_the_cut(packing: str, tmp_path: Path) -> None:
    documents = [{"name": f"{number * 7919 % 1000}", "number": number} for number in range(60_000)]
    source = tmp_path / "dump.json"
    packed = PACKINGS[packing](lines(documents).encode())
    source.write_bytes(packed[: len(packed) * 2 // 3])
    dump = read_dump(source)
    assert dump.values == documents[: len(dump.values)]
    assert len(dump.values) > 10_000
    assert [told.code for told in dump.diagnostics] == ["truncated"]


def test_more_than_fits_into_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hrclog.recorders.importers.mongo_text._MOST_BYTES", 10**6)
    source = tmp_path / "dump.json"
    source.write_bytes(gzip.compress(b"[" + b" " * 4 * 10**6 + b"]"))
    with pytest.raises(ImportDataError, match="when unpacked"):
        read_dump(source)


@pytest.mark.parametrize(
    ("name", "text", "number"),
    [
        ("$numberDouble", "1.5", 1.5),
        ("$numberDouble", 1.5, 1.5),
        ("$numberInt", "7", 7),
        ("$numberLong", "1780000000000", 1_780_000_000_000),
        ("$numberLong", 7, 7),
        ("$numberDecimal", "0.1", 0.1),
        ("$numberDecimal", "1E+3", 1000.0),
    ],
)
def test_extended_json_numbers_are_numbers(name: str, text: object, number: float) -> None:
    assert plain_value({name: text}) == number


@given(st.sampled_from(["$numberDouble", "$numberInt", "$numberLong", "$numberDecimal", "$date", "$oid"]), st.text())
def test_what_stands_for_no_number_is_left_as_it_is(name: str, text: str) -> None:
    value = plain_value({name: text})
    assert value == {name: text} or isinstance(value, int | float)


def test_a_number_that_is_none_costs_its_row_alone(tmp_path: Path) -> None:
    source = tmp_path / "dump.json"
    source.write_text('[{"t_start": {"$numberInt": "soon"}}, {"t_start": 1}]')
    assert read_dump(source).values == [{"t_start": {"$numberInt": "soon"}}, {"t_start": 1}]
