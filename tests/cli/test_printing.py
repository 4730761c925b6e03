"""No command prints a control character of a log, whatever names a log holds and wherever they are printed."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hrclog.cli.common import echo, echo_json, echo_lines
from hrclog.events import RunEnded, RunStarted, TaskEnded, TaskStarted
from hrclog.log.writing.writer import write_log

Run = Callable[..., Any]

CLI = Path(__file__).parents[2] / "hrclog" / "cli"
RAW = re.compile(r"click\.s?echo|\bprint\(|\.write\(|secho|style\(|sys\.__?std")
EVIL = "\x1b]0;title\x07 \x7f \x9b31m \u202e \u2028 \r \n \t \x00 =1+1"


@pytest.mark.parametrize("path", sorted(CLI.glob("*.py")), ids=lambda path: path.stem)
def test_commands_print_through_the_helpers_alone(path: Path) -> None:
    if path.stem == "common":
        return
    assert RAW.findall(path.read_text(encoding="utf-8")) == []


@given(st.text(st.characters() | st.sampled_from(EVIL)))
def test_a_line_is_printed_without_what_controls_a_terminal(text: str) -> None:
    import contextlib
    import io

    with contextlib.redirect_stdout(io.StringIO()) as stream:
        echo(text)
        echo_lines(f"{text}\nsecond")
        echo_json(json.dumps({"name": text, "": 1}, ensure_ascii=False, indent=2))
    line, rest = stream.getvalue().split("\n", 1)
    lines, _, document = rest.partition("second\n")
    assert line.isprintable()
    assert lines.replace("\n", "").isprintable()
    assert document.replace("\n", "").isprintable()
    assert json.loads(document)["name"] == text


@pytest.fixture
def logs(tmp_path: Path) -> tuple[Path, Path]:
    """Return two logs of one run each; every text in the first is hostile."""
    paths = tmp_path / "evil.mcap", tmp_path / "plain.mcap"
    for path, suffix in zip(paths, (EVIL, ""), strict=True):
        events: list[Any] = [RunStarted(time_ns=10**18, run_id=path.stem, name=f"run{suffix}", agents=(f"a{suffix}",))]
        for number in range(4):
            whose = {
                "run_id": path.stem,
                "agent": f"{'ab'[number % 2]}{suffix}",
                "task": f"task{suffix}",
                "task_type": f"type{suffix}",
                "execution_id": f"{number}{suffix}",
            }
            start_ns = 10**18 + number * 10**9
            outcome = "failed" if number == 3 else "succeeded"
            events.append(TaskStarted(time_ns=start_ns, **whose))
            events.append(TaskEnded(time_ns=start_ns + 15 * 10**8, outcome=outcome, reason=f"r{suffix}", **whose))
        events.sort(key=lambda event: event.time_ns)
        ended = RunEnded(time_ns=10**18 + 10**10, run_id=path.stem, reason=f"over{suffix}")
        write_log(path, [*events, ended])
    return paths


def commands(evil: Path, plain: Path, folder: Path) -> list[tuple[Any, ...]]:
    kb = folder / "kb.sqlite"
    return [
        ("info", evil),
        ("check", evil, plain),
        ("analyze", evil, "-o", folder / "out", "--recordings", "1"),
        ("compare", evil, plain),
        ("export", evil, "-o", folder / "tables", "--format", "csv"),
        ("kb", "update", evil, "--kb", kb),
        ("kb", "show", "--kb", kb),
        ("kb", "withdraw", f"run{EVIL}", "--kb", kb, "--reason", EVIL.replace("\0", "")),
        ("kb", "withdraw", f"none{EVIL}", "--kb", kb),
        ("score", evil, plain),
        ("report", evil, "-o", folder / "report.html"),
        ("view", folder / f"gone{EVIL}".replace("\0", "")),
        ("import", "mongo", folder / f"gone{EVIL}".replace("\0", ""), "-o", folder / "imported"),
        ("record", folder / "run.mcap", f"--{EVIL}"),
        ("recover", evil),
    ]


@pytest.mark.slow
@pytest.mark.parametrize("options", [(), ("--json",)], ids=["text", "json"])
def test_no_command_prints_what_a_log_says_raw(
    options: tuple[str, ...], run: Run, logs: tuple[Path, Path], tmp_path: Path
) -> None:
    seen = ""
    for command in commands(*logs, tmp_path):
        takes_json = command[0] not in ("view", "record")
        result = run(*command, *(options if takes_json else ()))
        for text in (result.out, result.err):
            assert [line for line in text.split("\n") if not line.isprintable()] == [], command
        seen += result.out + result.err
    assert "\\x1b]0;title\\x07" in seen or "\\u001b]0;title" in seen
