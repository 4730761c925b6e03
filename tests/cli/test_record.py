"""`hrclog record` as a process: streams that close, and what it acknowledges."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hrclog.log.reader import read_logs

LINES = [json.dumps({"kind": "heartbeat", "agent": f"agent {number}"}) for number in range(20)]
HRCLOG = f"'{sys.executable}' -m hrclog"


def piped(command: str, lines: list[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["bash", "-c", command], input="\n".join(lines), capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("redirect", "code", "told"),
    [(">&-", 0, ""), (">/dev/full", 1, "No space left"), ("| true; exit ${PIPESTATUS[1]}", 0, "Broken pipe")],
    ids=["closed", "full", "pipe"],
)
@pytest.mark.skipif(sys.platform == "win32", reason="needs bash")
def test_recording_goes_on_when_nobody_takes_the_acknowledgements(
    redirect: str, code: int, told: str, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    wait = "sleep 0.2; " if "true" in redirect else ""
    done = piped(f"{{ {wait}cat; }} | {HRCLOG} record '{path}' --ack {redirect}", LINES)
    assert "Traceback" not in done.stderr
    assert told in done.stderr
    assert read_logs([path]).events.height == len(LINES) + 2
    assert done.returncode == code


def test_each_kind_of_sample_is_acknowledged(
    tmp_path: Path, run: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    samples = [
        {"kind": "signal", "name": "force", "value": 1},
        {"kind": "joints", "agent": "robot", "values": {"turn": 1}},
        {"kind": "pose", "name": "cube", "position": [0, 0, 1]},
        {"kind": "scene", "scene": {"schema_version": 1}},
        {"kind": "description", "agent": "robot", "urdf": "<robot/>"},
    ]
    monkeypatch.setattr("sys.stdin", io.StringIO("\n".join(map(json.dumps, samples))))
    result = run("record", tmp_path / "run.mcap", "--ack")
    assert result.code == 0
    assert [json.loads(line) for line in result.out.splitlines()] == [
        {"signals": ["force"]},
        {"joints": ["robot"]},
        {"poses": ["cube"]},
        {"scenes": []},
        {"descriptions": ["robot"]},
    ]
    assert "poses of 'cube' are recorded and not drawn" in result.err


def test_a_line_without_an_end_costs_no_memory_and_no_other_line(
    tmp_path: Path, run: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hrclog.cli.record.MAX_CHARACTERS", 60)
    lines = [LINES[0], LINES[0][:-1] + " " * 400 + "}", LINES[1], "x" * 60, LINES[2], "y" * 61, "z" * 120]
    monkeypatch.setattr("sys.stdin", io.StringIO("\n".join(lines)))
    result = run("record", tmp_path / "run.mcap", "--json")
    assert (result.code, result.json()["n_events"], result.json()["n_refused"]) == (3, 3, 4)
    assert [f"line {number}:" in result.err for number in range(1, 8)] == [False, True, False, True, False, True, True]
