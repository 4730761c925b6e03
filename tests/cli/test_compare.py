"""`hrclog compare`: its contract, its tables, and what it says of sides that cannot be compared."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hrclog.analyzers.comparison import schemas
from hrclog.analyzers.comparison.compare import TABLES
from hrclog.analyzers.synergy.estimators import ESTIMATORS
from hrclog.analyzers.synergy.outlier_methods import OUTLIER_METHODS
from hrclog.events import RunEnded, RunStarted, TaskEnded, TaskStarted
from hrclog.log.writing.writer import write_log

pytestmark = pytest.mark.slow

Run = Callable[..., Any]

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture
def sides(samples: Path) -> tuple[str, str]:
    """Return two globs of five runs each."""
    return f"{samples}/campaign/paper_000[0-4].mcap", f"{samples}/campaign/paper_000[5-9].mcap"


def fast(*arguments: object) -> list[object]:
    return ["compare", *arguments, "--estimator", "ols", "--bootstrap", "40"]


def test_the_tables_and_what_they_rest_on_are_printed(run: Run, sides: tuple[str, str]) -> None:
    result = run(*fast(*sides))
    assert result.code == 0
    first, second, makespan, *_ = result.out.splitlines()
    assert first == f"A: {sides[0]}: 5 runs, 120 executions, agents: human, robot"
    assert second.startswith(f"B: {sides[1]}: 5 runs")
    assert makespan.startswith("makespan ")
    for title in ("Metrics per run", "Durations in s", "Plan and reality in s", "Synergies by ols"):
        assert title in result.out
    assert "Success rates" not in result.out  # no task failed
    assert " intervals were looked at, " in result.out


def test_tasks_that_failed_have_a_success_rate(run: Run, samples: Path) -> None:
    out = run(*fast(samples / "single.mcap", samples / "failures.mcap")).out
    [line] = [line for line in out.split("Success rates")[1].splitlines() if line.startswith("robot  pick_orange_box")]
    assert line.split()[2:] == ["1.00", "0.80", "-0.20", "n/a", "n/a", "4", "5"]
    assert out.count("There are no intervals") == 1
    assert "intervals were looked at" not in out


def test_the_json_result_has_the_documented_columns_and_is_what_is_written(
    run: Run, sides: tuple[str, str], tmp_path: Path
) -> None:
    result = run(*fast(*sides), "--json", "-o", tmp_path / "out")
    document = result.json()
    assert json.loads((tmp_path / "out" / "compare.json").read_text()) == document
    assert document["schema_version"] == 1
    assert len(document["a"]["run_ids"]) == len(document["b"]["run_ids"]) == 5
    for table in TABLES:
        for row in document[table]:
            assert list(row) == getattr(schemas, table.upper()).names(), table
    assert document["compared"] > document["differing"] >= 0
    assert run(*fast(*sides), "--json").out == result.out


def test_nothing_is_written_unless_asked(
    run: Run, sides: tuple[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(*fast(*sides)).code == 0
    assert list(tmp_path.iterdir()) == []


def test_b_against_a_is_a_against_b_turned_round(run: Run, sides: tuple[str, str]) -> None:
    forth, back = (run(*fast(*pair), "--json").json()["metrics"] for pair in (sides, sides[::-1]))
    for one, other in zip(forth, back, strict=True):
        assert one["difference"] == -other["difference"]
        assert one["ci_low"] == pytest.approx(-other["ci_high"])


def test_a_run_on_both_sides_is_named(run: Run, samples: Path, sides: tuple[str, str]) -> None:
    result = run(*fast(samples / "campaign", sides[0]))
    assert result.code == 1
    assert result.out == ""
    assert "run 'paper_0000'" in result.err
    assert "is on both sides" in result.err
    assert "and 4 more are" in result.err
    assert len(result.err.splitlines()) == 1


def test_a_side_without_logs_or_without_executions_is_one_sentence(
    run: Run, sides: tuple[str, str], tmp_path: Path
) -> None:
    result = run(*fast(sides[0], tmp_path))
    assert result.code == 1
    assert str(tmp_path) in result.err
    write_log(tmp_path / "idle.mcap", [RunStarted(time_ns=1, run_id="r"), RunEnded(time_ns=2, run_id="r")])
    result = run(*fast(tmp_path, sides[0]))
    assert result.code == 1
    assert "side A: found 1 run without an execution" in result.err
    assert len(result.err.splitlines()) == 1


@pytest.mark.parametrize("count", [1, 3])
def test_another_number_of_sides_is_a_usage_error_that_speaks_of_quotes(run: Run, count: int) -> None:
    result = run("compare", *"abc"[:count])
    assert result.code == 2
    assert "expected A and B; put a glob in quotes" in result.err


def test_a_damaged_log_is_told_and_the_rest_is_compared(
    run: Run, samples: Path, sides: tuple[str, str], tmp_path: Path
) -> None:
    (tmp_path / "cut.mcap").write_bytes((samples / "failures.mcap").read_bytes()[:-3000])
    (tmp_path / "good.mcap").write_bytes((samples / "single.mcap").read_bytes())
    result = run(*fast(sides[0], tmp_path), "--json")
    assert result.code == 3
    assert "cut.mcap" in result.err
    assert any(row["severity"] == "error" and "cut.mcap" in row["path"] for row in result.json()["diagnostics"])


def test_findings_that_name_no_file_name_the_side(run: Run, samples: Path, tmp_path: Path) -> None:
    table = samples / "study.csv"
    assert run("import", "table", table, "-o", tmp_path / "study").code == 0
    told = run(*fast(tmp_path / "study" / "P01_*.mcap", tmp_path / "study" / "P02_*.mcap")).err
    assert "warning: A: all 96 executions succeeded" in told
    assert "warning: B: all 96 executions succeeded" in told


def test_an_output_folder_that_cannot_be_written_is_said_before_the_work(run: Run, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    result = run(*fast("missing", "missing"), "-o", tmp_path / "file" / "out")
    assert (result.code, result.out) == (1, "")
    assert "choose another folder" in result.err


def test_hostile_names_do_not_reach_the_terminal(run: Run, tmp_path: Path) -> None:
    for name in "ab":
        events = [
            RunStarted(time_ns=0, run_id=name),
            TaskStarted(time_ns=1, run_id=name, agent="\x1b]0;x\x07A", task="\x1b[31mred", execution_id="e"),
            TaskEnded(time_ns=9, run_id=name, agent="\x1b]0;x\x07A", task="\x1b[31mred", execution_id="e"),
        ]
        write_log(tmp_path / f"{name}.mcap", events)
    result = run(*fast(tmp_path / "a.mcap", tmp_path / "b.mcap"))
    assert result.code == 0
    assert "\x1b" not in result.out + result.err


def test_the_command_offers_every_estimator_and_outlier_method(run: Run) -> None:
    text = run("compare", "--help").out
    assert f"[{'|'.join(ESTIMATORS)}]" in text
    assert f"[{'|'.join(OUTLIER_METHODS)}]" in text


def test_the_page_names_every_column_and_measure(run: Run, sides: tuple[str, str]) -> None:
    page = (DOCS / "compare.md").read_text()
    for table in TABLES:
        assert f"`{table}`" in page
        for column in getattr(schemas, table.upper()):
            assert f"`{column}`" in page, column
    document = run(*fast(*sides), "--json").json()
    for key in document:
        assert f"`{key}`" in page, key
    for row in document["plan"]:
        assert f"`{row['measure']}`" in page, row["measure"]
