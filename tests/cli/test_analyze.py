"""`hrclog analyze`: the contract, the files, and bad input beside good."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import polars as pl
import pytest

from hrclog.analyzers.projections import schemas
from hrclog.analyzers.synergy.estimators import ESTIMATORS
from hrclog.analyzers.synergy.outlier_methods import OUTLIER_METHODS
from hrclog.events import RunEnded, RunStarted, TaskEnded, TaskStarted
from hrclog.log.writing.writer import write_log

Run = Callable[..., Any]

CONTRACT = {
    "runs": "run_id name makespan_s agents n_executions metrics",
    "durations": ("agent task count n_failed n_censored success_rate mean_s std_s median_s min_s max_s"),
    "synergies": (
        "agent task other_agent other_task synergy synergy_free std_err ci_low ci_high n overlap_s status estimator"
    ),
    "overlaps": "agent task other_agent other_task overlap_s n mean_ratio",
    "diagnostics": "severity code path message",
}


class Analyzed(Protocol):
    """What conftest's fixture gives."""

    folder: Path
    out: str


def test_the_json_result_keeps_to_the_contract(analyzed: Analyzed, run: Run, samples: Path) -> None:
    document = json.loads(analyzed.out)
    assert document["schema_version"] == 1
    for section, names in CONTRACT.items():
        assert document[section] or section == "diagnostics", section
        for row in document[section]:
            assert set(names.split()) <= row.keys(), section
    [remark, *_] = run("check", samples / "broken_off.mcap", "--json").json()["diagnostics"]
    assert set(CONTRACT["diagnostics"].split()) <= remark.keys()
    metrics = document["runs"][0]["metrics"]
    assert set(metrics["idle"]) == {"human", "robot"}
    assert set(metrics["concurrent_activity"]) == {"human|robot"}
    assert set(metrics["functional_delay"]) == {"human>robot", "robot>human"}
    assert json.loads((analyzed.folder / "analysis.json").read_text()) == document


@pytest.mark.parametrize(("estimator", "always_known"), [("aft", "synergy_free"), ("ols", "synergy")])
def test_there_is_one_synergy_row_per_ordered_pair_of_tasks_of_different_agents(
    estimator: str, always_known: str, run: Run, samples: Path, tmp_path: Path
) -> None:
    document = run(
        "analyze", samples / "campaign", "-o", tmp_path, "--estimator", estimator, "--recordings", "0", "--json"
    ).json()
    tasks = {(row["agent"], row["task"]) for row in document["durations"]}
    expected = {(*a, *b) for a in tasks for b in tasks if a[0] != b[0]}
    found = [(r["agent"], r["task"], r["other_agent"], r["other_task"]) for r in document["synergies"]]
    assert len(found) == len(set(found))
    assert set(found) == expected
    for row in document["synergies"]:
        # aft knows synergies of some that are weakly identified, namely all but the free one
        assert (row[always_known] is None) == (row["status"] in ("unobserved", "weakly_identified"))
        assert row["synergy"] is not None or row["status"] in ("unobserved", "weakly_identified")
        assert (row["status"] == "unobserved") == (row["n"] == 0)


def test_tables_have_their_documented_schemas_and_every_run_has_a_recording(analyzed: Analyzed) -> None:
    folder = analyzed.folder
    for name in ("intervals", "overlaps", "durations", "synergies", "runs"):
        assert pl.read_parquet(folder / f"{name}.parquet").schema == getattr(schemas, name.upper())
    assert pl.read_parquet(folder / "events.parquet").height > 0
    assert (folder / "analysis.rrd").stat().st_size > 0
    assert len(list((folder / "runs").glob("*.rrd"))) == 12


@pytest.mark.slow
def test_recordings_of_an_earlier_analysis_in_the_same_folder_do_not_stay_behind(
    run: Run, samples: Path, tmp_path: Path
) -> None:
    run("analyze", samples / "single.mcap", "-o", tmp_path)
    assert [path.name for path in (tmp_path / "runs").iterdir()] == ["paper_0000.rrd"]
    (tmp_path / "runs" / "mine.rrd").touch()
    run("analyze", samples / "failures.mcap", "-o", tmp_path)
    assert sorted(path.name for path in (tmp_path / "runs").iterdir()) == ["failures_0000.rrd", "mine.rrd"]


@pytest.mark.slow
@pytest.mark.parametrize("estimator", ["ols", "paper"])
@pytest.mark.parametrize("outliers", ["none", "isolation-forest"])
def test_every_estimator_and_outlier_method_runs(
    run: Run, samples: Path, tmp_path: Path, estimator: str, outliers: str
) -> None:
    result = run(
        "analyze", samples / "single.mcap", "-o", tmp_path, "--json", "--estimator", estimator, "--outliers", outliers
    )
    assert result.code == 0
    assert {row["estimator"] for row in result.json()["synergies"]} == {estimator}


def test_one_bad_file_never_hides_the_others(run: Run, samples: Path, tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "text.mcap").write_text("not a log")
    (tmp_path / "in" / "empty.mcap").touch()
    (tmp_path / "in" / "good.mcap").write_bytes((samples / "single.mcap").read_bytes())
    (tmp_path / "in" / "cut.mcap").write_bytes((samples / "failures.mcap").read_bytes()[:-3000])
    result = run("analyze", tmp_path / "in", tmp_path / "missing.mcap", "-o", tmp_path / "out", "--json")
    assert result.code == 3
    document = result.json()
    assert {row["name"] for row in document["runs"]} >= {"paper_0000"}
    codes = {(Path(row["path"]).name, row["code"]) for row in document["diagnostics"] if row["severity"] == "error"}
    assert codes >= {
        ("text.mcap", "unreadable_file"),
        ("empty.mcap", "no_header"),
        ("missing.mcap", "unreadable_file"),
    }
    assert any(name == "cut.mcap" for name, _ in codes)
    for name in ("text.mcap", "empty.mcap", "missing.mcap", "cut.mcap"):
        assert name in result.err


def test_nothing_to_read_fails_with_one_sentence(run: Run, tmp_path: Path) -> None:
    for argument in (tmp_path / "missing.mcap", tmp_path, f"{tmp_path}/*.mcap"):
        result = run("analyze", argument, "-o", tmp_path / "out")
        assert result.code == 1
        assert result.out == ""
        assert str(tmp_path) in result.err
        assert len(result.err.splitlines()) == 1


def test_a_kill_before_the_header_is_zero_events_and_exit_3(run: Run, tmp_path: Path) -> None:
    (tmp_path / "a.mcap.partial").touch()
    result = run("analyze", tmp_path / "a.mcap.partial", "-o", tmp_path / "out", "--json")
    assert result.code == 3
    assert result.json()["runs"] == []
    assert "0 events" in result.err


def test_one_agent_alone_gives_durations_and_metrics_and_exit_0(run: Run, tmp_path: Path) -> None:
    events = [RunStarted(time_ns=0, run_id="r", name="alone")]
    for n in range(3):
        events.append(TaskStarted(time_ns=n * 10, run_id="r", agent="H", task="pick", execution_id=f"e{n}"))
        events.append(TaskEnded(time_ns=n * 10 + 5, run_id="r", agent="H", task="pick", execution_id=f"e{n}"))
    write_log(tmp_path / "alone.mcap", [*events, RunEnded(time_ns=40, run_id="r")])
    result = run("analyze", tmp_path / "alone.mcap", "-o", tmp_path / "out", "--json")
    assert result.code == 0
    document = result.json()
    assert document["synergies"] == []
    assert document["durations"][0]["count"] == 3
    assert document["runs"][0]["metrics"]["idle"]["H"] == pytest.approx(1 - 15 / 25)


def test_the_headline_tells_makespans_of_runs_that_ended_well_and_how_many_those_are(run: Run, tmp_path: Path) -> None:
    for number, outcome in enumerate(("succeeded", "succeeded", "failed")):
        about = {"run_id": f"r{number}", "agent": "H", "task": "pick", "execution_id": "e"}
        seconds = 20 + 2 * number if outcome == "succeeded" else 1
        events = [
            RunStarted(time_ns=0, run_id=f"r{number}"),
            TaskStarted(time_ns=0, **about),
            TaskEnded(time_ns=seconds * 10**9, **about, outcome=outcome),
            RunEnded(time_ns=30 * 10**9, run_id=f"r{number}", outcome=outcome),
        ]
        write_log(tmp_path / f"{number}.mcap", events)
    headline = "makespan 21.0 s +- 1.4 (sample standard deviation, n = 2)"
    logs = [tmp_path / f"{number}.mcap" for number in range(3)]
    for given, expected in (
        (logs[:2], headline),
        (logs, f"{headline} (2 of 3 runs, those that ended well)"),
        (logs[2:], "makespan not known: the run did not end well"),
    ):
        result = run("analyze", *given, "-o", tmp_path / "out", "--recordings", "0")
        assert result.out.splitlines()[1] == expected


def test_an_output_folder_that_cannot_be_written_is_said_before_the_work(
    run: Run, samples: Path, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    result = run("analyze", samples / "single.mcap", "-o", tmp_path / "file" / "out")
    assert result.code == 1
    assert str(tmp_path / "file") in result.err
    assert "choose another folder" in result.err


def test_hostile_names_reach_neither_the_terminal_nor_other_folders(run: Run, tmp_path: Path) -> None:
    name = "../../\x1b[31mred\x07 / évil\u202e"
    events = [
        RunStarted(time_ns=0, run_id="r", name=name),
        TaskStarted(time_ns=1, run_id="r", agent="\x1b]0;x\x07A", task="<img onerror>", execution_id="e"),
        TaskEnded(time_ns=9, run_id="r", agent="\x1b]0;x\x07A", task="<img onerror>", execution_id="e"),
        TaskStarted(time_ns=2, run_id="r", agent="B", task="a/b\n| c |", execution_id="f"),
        TaskEnded(time_ns=8, run_id="r", agent="B", task="a/b\n| c |", execution_id="f"),
    ]
    write_log(tmp_path / "hostile.mcap", sorted(events, key=lambda event: event.time_ns))
    result = run("analyze", tmp_path / "hostile.mcap", "-o", tmp_path / "deep" / "out")
    assert result.code == 0
    assert "\x1b" not in result.out + result.err
    written = list(tmp_path.rglob("*.rrd"))
    assert len(written) == 2
    assert all((tmp_path / "deep" / "out") in path.parents for path in written)


@pytest.mark.slow
def test_results_are_the_same_every_time(run: Run, samples: Path, tmp_path: Path, analyzed: Analyzed) -> None:
    assert run("analyze", samples / "campaign", "-o", tmp_path, "--json").out == analyzed.out


@pytest.mark.slow
def test_the_authors_runs_take_the_planned_path(run: Run, data_dir: Path, tmp_path: Path) -> None:
    source = data_dir / "safety_areas" / "task_results.json"
    assert run("import", "mongo", source, "-o", tmp_path / "A").code == 0
    document = run("analyze", tmp_path / "A", "-o", tmp_path / "out", "--recordings", "2", "--json").json()
    assert len(document["runs"]) == 51
    assert sum(row["n_executions"] for row in document["runs"]) == 1224
    recipes = {row["recipe"] for row in json.loads(source.read_text())}
    assert {row["name"] for row in document["runs"]} == recipes
    published = json.loads((data_dir / "safety_areas" / "task_synergies.json").read_text())
    counters = {
        (row["agent"], row["agent_skill"], row["concurrent_agent"], row["concurrent_skill"]): row["counter"]
        for row in published
    }
    found = {(r["agent"], r["task"], r["other_agent"], r["other_task"]): r["n"] for r in document["synergies"]}
    assert {key: found[key] for key in counters} == counters


def test_the_command_offers_every_estimator_and_outlier_method(run: Run) -> None:
    text = run("analyze", "--help").out
    assert f"[{'|'.join(ESTIMATORS)}]" in text
    assert f"[{'|'.join(OUTLIER_METHODS)}]" in text
