"""`--clock` on every command that reads logs, and warnings beside every number that a wrong clock spoils."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import pytest
from clock_runs import BEGIN, HUMAN, SECOND, Written, ahead, jumps, write
from clock_runs import run as events_of_run

import hrclog
from hrclog.analyzers.report.findings import findings
from hrclog.cli import VERBS, cli
from hrclog.cli.kb import command as kb
from hrclog.cli.summary import summary

Run = Callable[..., Any]

AN_HOUR = "human=+3600s"
READ_LOGS = ("analyze", "check", "compare", "export", "info", "plan", "report", "score", "view")


@pytest.fixture
def hour_ahead(tmp_path: Path) -> Path:
    """Return a folder of three runs in which the human's clock is an hour ahead."""
    folder = tmp_path / "runs"
    folder.mkdir()
    for number in range(3):
        write(folder / f"{number}.mcap", run_of(number))
    return folder


def test_the_findings_of_a_report_begin_with_the_doubt(tmp_path: Path) -> None:
    analysis = hrclog.analyze(write(tmp_path / "a.mcap", run_with_jump()))
    first = next(iter(findings(analysis)))
    assert (first.kind, "Times are in doubt" in first.text) == ("doubt", True)
    assert "jumps by +3600 s" in first.details[0]


def run_of(number: int) -> list[Written]:
    return events_of_run(ahead(3600), run_id=f"run {number}")


def options(command: click.Command) -> set[str]:
    return {name for parameter in command.params for name in parameter.opts}


def test_every_command_that_reads_logs_has_the_option() -> None:
    context = click.Context(cli)
    for verb in VERBS:
        command = cli.get_command(context, verb)
        assert command is not None
        assert ("--clock" in options(command)) == (verb in READ_LOGS), verb
    assert {name for name, command in kb.commands.items() if "--clock" in options(command)} == {
        "ingest",
        "update",
        "rebuild",
    }


def test_a_log_time_check_names_the_agent_and_the_option_corrects_it(run: Run, hour_ahead: Path) -> None:
    chosen = [text for code in ("clock_offset", "after_run_end", "clock_corrected") for text in ("--only", code)]
    found = run("check", hour_ahead, *chosen)
    assert found.code == 0
    assert f"--clock {AN_HOUR} corrects it" in found.err
    assert "6 warnings" in found.out  # the human goes on after the end of each run
    corrected = run("check", hour_ahead, "--clock", AN_HOUR, "--strict", *chosen)
    assert corrected.code == 0
    assert "counts as +3600s ahead" in corrected.err


def test_the_summary_tells_the_doubt_and_the_correction(hour_ahead: Path) -> None:
    doubted = summary(hrclog.analyze(hour_ahead), Path("out"), 0)
    assert "Times are in doubt, and with them the numbers above:\n  the clock of 'human' is off by +3600 s" in doubted
    corrected = summary(hrclog.analyze(hour_ahead, clocks={HUMAN: 3600 * SECOND}), Path("out"), 0)
    assert "Times were corrected:\n  the clock of 'human' counts as +3600s ahead" in corrected
    assert "in doubt" not in corrected
    assert "robot: robot_0  human: human_0" in corrected


@pytest.mark.slow
def test_a_jump_never_becomes_a_factor_without_a_warning_beside_it(run: Run, tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", run_with_jump())
    analysed = run("analyze", path, "-o", tmp_path / "out")
    assert "the clock of 'human' jumps by +3600 s" in analysed.out
    report = run("report", path, "-o", tmp_path / "report.html", "--runs", "0", "--json")
    doubts = [finding for finding in report.json()["findings"] if finding["kind"] == "doubt"]
    assert "Times are in doubt" in doubts[0]["text"]
    assert "jumps by +3600 s" in doubts[0]["details"][0]
    assert "jumps by +3600 s" in (tmp_path / "report.html").read_text(encoding="utf-8")


def run_with_jump() -> list[Written]:
    return events_of_run(jumps(3600, BEGIN + 25 * SECOND))


@pytest.mark.slow
def test_a_report_says_how_it_was_corrected(run: Run, hour_ahead: Path, tmp_path: Path) -> None:
    report = run(
        *("report", hour_ahead, "-o", tmp_path / "report.html", "--runs", "0", "--json", "--clock", "human=+1h")
    )
    assert any("Times were corrected" in finding["text"] for finding in report.json()["findings"])
    assert f"--clock {AN_HOUR}" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_the_other_commands_correct_too(run: Run, hour_ahead: Path, tmp_path: Path) -> None:
    info = run("info", hour_ahead, "--json", "--clock", AN_HOUR).json()
    assert [row["makespan_s"] for row in info["runs"]] == pytest.approx([63.5] * 3)
    exported = run("export", hour_ahead, "-o", tmp_path / "tables", "--table", "overlaps", "--clock", AN_HOUR, "--json")
    assert exported.json()["written"][0]["rows"] > 0
    sides = (hour_ahead / "0.mcap", hour_ahead / "1.mcap")
    compared = run("compare", *sides, "--bootstrap", "0", "--clock", AN_HOUR, "--json")
    assert "clock_corrected" in {finding["code"] for finding in compared.json()["diagnostics"]}
    place = str(tmp_path / "kb.sqlite")
    ingested = run("kb", "ingest", hour_ahead, "--kb", place, "--json", "--clock", AN_HOUR).json()
    assert "clock_corrected" in {finding["code"] for finding in ingested["diagnostics"]}
    assert run("kb", "rebuild", hour_ahead, "--kb", place, "--clock", AN_HOUR).code == 0
    assert run("kb", "update", hour_ahead, "--kb", place, "--clock", AN_HOUR).code == 0


def test_scores_are_those_of_runs_whose_clocks_are_right(run: Run, hour_ahead: Path, tmp_path: Path) -> None:
    right = tmp_path / "right"
    right.mkdir()
    for number in range(3):
        write(right / f"{number}.mcap", run_of_right(number))
    method = ("--cv", "3", "--estimator", "mean", "--json")
    assert run("score", hour_ahead, *method, "--clock", AN_HOUR).json() == run("score", right, *method).json()


def run_of_right(number: int) -> list[Written]:
    return events_of_run(run_id=f"run {number}")


@pytest.mark.parametrize(
    ("value", "complaint"),
    [
        ("human", "expected AGENT=OFFSET"),
        ("=5s", "expected AGENT=OFFSET"),
        ("human=5", "expected a number and one of"),
        ("human=soon", "expected a number and one of"),
    ],
)
def test_a_wrong_value_is_a_usage_error(run: Run, hour_ahead: Path, value: str, complaint: str) -> None:
    done = run("check", hour_ahead, "--clock", value)
    assert done.code == 2
    assert complaint in done.err


def test_an_unknown_agent_and_two_offsets_are_errors(run: Run, hour_ahead: Path) -> None:
    done = run("info", hour_ahead, "--clock", "humn=1s")
    assert done.code == 1
    assert f"expected one of '{HUMAN}', 'robot'" in done.err
    assert run("info", hour_ahead, "--clock", "human=1s", "--clock", "human=2s").code == 2
    assert run("info", hour_ahead, "--clock", "human=1s", "--clock", "human=1000ms").code == 0
