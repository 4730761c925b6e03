"""What the verbs share: progress that stays quiet, tables that fit, text that is safe to print."""

from __future__ import annotations

import sys

import pytest

from hrclog.cli.common import Progress, number, printable, shortened, table


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Return a clock whose only entry is the time in seconds."""
    now = [100.0]
    monkeypatch.setattr("hrclog.cli.common.time.monotonic", lambda: now[0])
    return now


def test_progress_shows_only_once_it_has_taken_a_second(
    clock: list[float], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    progress = Progress("simulating", 10)
    for _ in range(3):
        clock[0] += 0.4
        progress.advance(2)
    progress()
    progress.done()
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == "\rsimulating 6/10\r\x1b[K"


def test_progress_without_a_terminal_says_nothing(
    clock: list[float], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: False)
    progress = Progress("reading")
    clock[0] += 5
    progress()
    progress.done()
    assert capsys.readouterr().err == ""


def test_tables_are_aligned_and_safe() -> None:
    text = table(("task", "n"), [("pick", "7"), ("\x1b[31mred", "12")])
    assert text.splitlines() == ["task          n", "-----------  --", "pick          7", "\\x1b[31mred  12"]


def test_long_cells_keep_their_ends() -> None:
    cell = shortened("a" * 100 + "z" * 100)
    assert len(cell) == 80
    assert (cell[0], cell[-1]) == ("a", "z")
    assert "…" in cell


def test_what_is_not_known_is_not_a_number() -> None:
    assert number(None) == "n/a"
    assert number(1.005, 1) == "1.0"
    assert printable("é 計") == "é 計"
