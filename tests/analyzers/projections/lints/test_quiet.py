"""Lints stay quiet on sound runs: simulated, real and sample ones; what they say of those is true and listed here."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import pytest

import hrclog.sample_logs
from hrclog.analyzers.projections.intervals import rebuild
from hrclog.analyzers.projections.lints.lints import lint
from hrclog.analyzers.projections.overlaps import overlaps
from hrclog.analyzers.projections.runs import runs
from hrclog.diagnostic import Diagnostic
from hrclog.log.reader import read_logs
from hrclog.log.writing.writer import write_log
from hrclog.recorders.importers.mongo import import_mongo
from hrclog.sim.run import simulate_run
from hrclog.sim.scenario import load_scenario

SAMPLES = Path(hrclog.sample_logs.__file__).parent

TRUE_OF_SAMPLES = {
    "broken_off.mcap": {"open_execution", "missing_from_plan", "run_not_ended"},
    "imported.mcap": {"single_outcome"},
    "killed.mcap.partial": {"open_execution", "few_outcomes", "run_not_ended"},
}


def remarks(paths: Iterable[Path]) -> list[Diagnostic]:
    events = read_logs(paths).events
    executions, illegal = rebuild(events)
    return [*illegal, *lint(events, executions, overlaps(executions), runs(events, executions))]


@pytest.mark.parametrize("name", ["paper", "failures", "three-agents", "kitting", "authors-areas", "authors-ssm"])
def test_simulated_runs_are_quiet(name: str, tmp_path: Path) -> None:
    scenario = load_scenario(name)
    for index in range(5):
        write_log(tmp_path / f"{index}.mcap", simulate_run(scenario, 7, index).events)
    assert remarks([tmp_path]) == []


@pytest.mark.parametrize("path", sorted(SAMPLES.glob("*.mcap*")), ids=lambda path: str(path.name))
def test_of_a_sample_only_is_said_what_is_true(path: Path) -> None:
    assert {remark.code for remark in remarks([path])} == TRUE_OF_SAMPLES.get(path.name, set())


def test_the_sample_campaign_is_quiet() -> None:
    assert remarks([SAMPLES / "campaign"]) == []


@pytest.mark.slow
def test_of_the_real_runs_only_is_said_that_all_succeeded(data_dir: Path, tmp_path: Path) -> None:
    for number, name in enumerate(("task_results.json", "task_results_online.json")):
        import_mongo([data_dir / "safety_areas" / name], tmp_path / str(number))
    found = remarks([tmp_path / "0", tmp_path / "1"])
    assert Counter(remark.code for remark in found) == {"single_outcome": 1}
    assert "all 6024 executions succeeded" in found[0].message


@pytest.mark.parametrize(
    ("name", "code", "texts"),
    [
        ("after_run_ended.mcap", "after_run_end", ("e9", "10.000 s")),
        ("pause_never_resumed.mcap", "never_resumed", ("e1", "20:26:42")),
        ("planned_end_before_start.mcap", "planned_backwards", ("e1", "7.000 s", "unset")),
        ("identical_durations.mcap", "identical_durations", ("'robot'", "'pick'", "30", "2.000 s")),
        ("thirty_all_succeeded.mcap", "single_outcome", ("all 30",)),
        ("agent_not_of_the_run.mcap", "undeclared_agent", ("'robto'", "'robot'", "'human'")),
        ("shorter_run", "short_run", ("rep_3", "10", "24")),
    ],
)
def test_a_shared_case_is_named(name: str, code: str, texts: tuple[str, ...], data_dir: Path) -> None:
    cases = data_dir.parent / "cases" / "check"
    if not cases.is_dir():
        pytest.skip("no shared samples")
    [told] = [remark for remark in remarks([cases / name]) if remark.code == code]
    assert [text for text in texts if text not in told.message] == []
