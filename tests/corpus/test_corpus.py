"""Damaged logs of every kind that once failed are read, and recovered, as they were judged to be right."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from damaged_corpus import CORPUS, damaged_files

from hrclog.analyzers.projections.intervals import rebuild
from hrclog.errors import HrclogError
from hrclog.log.reader import read_logs
from hrclog.log.recover import recover

FILES = damaged_files()
EXPECTED = json.loads((CORPUS / "expect.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", FILES)
def test_a_damaged_file_is_read_as_expected(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(FILES[name])
    try:
        logs = read_logs([path], signals=True)
    except HrclogError:
        read: list[object] = [1]
    else:
        findings = [*logs.diagnostics, *rebuild(logs.events)[1]]
        is_damaged = any(finding.severity == "error" for finding in findings)
        read = [3 if is_damaged else 0, *sorted({finding.code for finding in findings})]
    assert read == EXPECTED[name], "if that is right: python benchmarks/make_corpus.py --expect"
    try:
        recovered = recover(path, tmp_path / "recovered.mcap")
    except HrclogError:
        return
    again = read_logs([recovered.path])
    assert read[0] == 0 or any(finding.severity == "error" for finding in again.diagnostics), "it looks cleaner"


def test_every_file_has_an_expectation() -> None:
    assert set(EXPECTED) == set(FILES)
    assert len(FILES) >= 40
