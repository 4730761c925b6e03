"""An estimator, an importer and an exporter of a user's go through every verb, without a change to our files."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import extensions
import pytest

import hrclog
from hrclog import Foreign, Importer, plugins
from hrclog.analyzers.exporters.exporters import EXPORTERS
from hrclog.analyzers.synergy.estimators import ESTIMATORS
from hrclog.errors import HrclogError, ImportDataError, KnowledgeError
from hrclog.log.reader import read_logs
from hrclog.plugins import PluginError, Registry
from hrclog.recorders.importers.importers import IMPORTERS
from hrclog.recorders.importers.writing import import_files

ROOT = Path(__file__).parents[2]
SAMPLES = ROOT / "sample_logs"
Run = Callable[..., Any]

CAMPAIGN = str(SAMPLES / "campaign")
PATH = "extensions:MedianRatio"
GONE_SOON = "from extensions import MedianRatio as Base\nclass Mine(Base): name = 'mine'\n"


@pytest.fixture(autouse=True)
def forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let what a test adds to the tables be gone after it."""
    for table in (ESTIMATORS, IMPORTERS, EXPORTERS):
        for name in ("_loaded", "_added"):
            monkeypatch.setattr(table, name, dict(getattr(table, name)))


@pytest.fixture
def registered() -> str:
    hrclog.register_estimator(extensions.MedianRatio)
    return "median-ratio"


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Act as if a package with entry points were installed."""
    groups = {
        "hrclog.estimators": {"median-ratio": PATH},
        "hrclog.importers": {"diary": "extensions:Diary"},
        "hrclog.exporters": {"markdown": "extensions:Markdown"},
    }

    def entry_points(group: str) -> list[SimpleNamespace]:
        return [SimpleNamespace(name=name, value=value) for name, value in groups.get(group, {}).items()]

    monkeypatch.setattr(plugins, "entry_points", entry_points)


@pytest.mark.parametrize("verb", ["analyze", "score", "compare", "report"])
def test_help_names_an_estimator_that_was_registered(verb: str, registered: str, run: Run) -> None:
    assert registered in run(verb, "--help").out


def test_help_of_a_knowledge_base_names_it_too(registered: str, run: Run) -> None:
    assert registered in run("kb", "update", "--help").out


@pytest.mark.parametrize("name", ["median-ratio", PATH])
def test_analyze_takes_an_estimator_by_name_or_path(name: str, run: Run, tmp_path: Path) -> None:
    if ":" not in name:
        hrclog.register_estimator(extensions.MedianRatio)
    result = run("analyze", CAMPAIGN, "-o", tmp_path, "--estimator", name, "--recordings", "0", "--json")
    assert result.code == 0, result.err
    analysis = json.loads(result.out)
    assert analysis["estimator"] == "median-ratio"
    factors = [row["synergy"] for row in analysis["synergies"] if row["synergy"] is not None]
    assert len(factors) > 20
    assert all(0.3 < factor < 3 for factor in factors)


@pytest.mark.slow
def test_an_estimator_survives_worker_processes(registered: str, run: Run, tmp_path: Path) -> None:
    options = ("--estimator", registered, "--bootstrap", "40", "--recordings", "0", "--json")
    alone = run("analyze", CAMPAIGN, "-o", tmp_path / "a", *options)
    shared = run("analyze", CAMPAIGN, "-o", tmp_path / "b", *options, "--workers", "2")
    assert shared.code == 0, shared.err
    assert alone.out == shared.out
    assert any(row["ci_low"] is not None for row in json.loads(alone.out)["synergies"])


def test_a_report_says_what_it_assumes(registered: str, run: Run, tmp_path: Path) -> None:
    result = run("report", CAMPAIGN, "-o", tmp_path / "r.html", "--estimator", registered, "--runs", "0")
    assert result.code == 0, result.err
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "a ratio of medians, which takes a meeting of any length for a whole one." in page
    assert extensions.MedianRatio.caution in page


def test_it_is_scored_and_compared(registered: str, run: Run, tmp_path: Path) -> None:
    result = run("score", CAMPAIGN, "--cv", "2", "--estimator", registered, "--estimator", "mean", "--json")
    assert result.code == 0, result.err
    assert list(json.loads(result.out)["estimators"]) == [registered, "mean"]
    logs = sorted((SAMPLES / "campaign").glob("*.mcap"))
    for side, part in (("a", logs[:6]), ("b", logs[6:])):
        (tmp_path / side).mkdir()
        for log in part:
            (tmp_path / side / log.name).symlink_to(log)
    result = run("compare", tmp_path / "a", tmp_path / "b", "--estimator", registered, "--bootstrap", "0", "--json")
    assert result.code == 0, result.err
    assert json.loads(result.out)["estimator"] == registered


def test_a_knowledge_base_names_an_estimator_that_is_not_there(run: Run, tmp_path: Path) -> None:
    kb = tmp_path / "kb.sqlite"
    log = SAMPLES / "single.mcap"
    assert run("kb", "update", log, "--kb", kb, "--estimator", PATH).code == 0
    assert PATH in run("kb", "show", "--kb", kb).out
    more = SAMPLES / "failures.mcap"
    assert run("kb", "update", more, "--kb", kb).code == 0  # it is found again by its path
    with hrclog.open_knowledge(kb) as opened:
        made = opened.statistics()
        assert made is not None
        assert made.estimator == PATH


def test_statistics_of_an_absent_estimator_name_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from hrclog.analyzers.learning.ingest import ingest_logs, update_statistics

    kb_path = tmp_path / "kb.sqlite"
    (tmp_path / "gone_soon.py").write_text(GONE_SOON)
    monkeypatch.syspath_prepend(str(tmp_path))
    with hrclog.open_knowledge(kb_path, create=True) as kb:
        ingest_logs(kb, [SAMPLES / "single.mcap"])
        update_statistics(kb, "gone_soon:Mine")
        ESTIMATORS._loaded.pop("gone_soon:Mine")
        monkeypatch.setitem(__import__("sys").modules, "gone_soon", None)
        with pytest.raises(KnowledgeError, match="made by estimator 'gone_soon:Mine', which is not there"):
            update_statistics(kb)
        assert update_statistics(kb, "ols")


@pytest.mark.usefixtures("installed")
def test_entry_points_are_found(run: Run) -> None:
    assert "median-ratio" in run("analyze", "--help").out
    assert "markdown" in run("export", "--help").out
    assert "Import diaries" in run("import", "--help").out
    analysis = hrclog.analyze(SAMPLES / "single.mcap", estimator="median-ratio")
    assert analysis.estimator == "median-ratio"


@pytest.mark.usefixtures("installed")
def test_an_importer_of_a_user_writes_logs(run: Run, tmp_path: Path) -> None:
    diary = tmp_path / "diary.csv"
    diary.write_text("monday,human,place,1,3\nmonday,robot,pick,2,4.5\ntuesday,robot,pick,1,2\n")
    result = run("import", "diary", diary, "-o", tmp_path / "runs", "--offset-s", "1e6", "--json")
    assert result.code == 0, result.err
    imported = json.loads(result.out)
    assert (imported["n_runs"], imported["n_executions"], imported["diaries"]) == (2, 3, 2)
    intervals = hrclog.intervals(hrclog.read_events(tmp_path / "runs"))
    assert intervals.height == 3
    assert intervals["start_ns"].min() == 1_000_001_000_000_000
    again = run("import", "extensions:Diary", diary, "-o", tmp_path / "runs", "--offset-s", "1e6")
    assert "0 logs written" in again.out
    assert "2 there already" in again.out


@pytest.mark.usefixtures("installed")
def test_an_exporter_of_a_user_writes_tables(run: Run, tmp_path: Path) -> None:
    for number, name in enumerate(("markdown", "extensions:Markdown")):
        folder = tmp_path / str(number)
        result = run("export", SAMPLES / "single.mcap", "-o", folder, "--format", name, "--table", "runs")
        assert result.code == 0, result.err
        assert (folder / "runs.md").read_text().startswith("| run_id | ")


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("extensions:Broken", "estimator 'broken': it raised ZeroDivisionError: nothing to divide by, expected a fit"),
        ("extensions:Shapeless", "estimator 'shapeless': it returned DataFrame, expected a Fit"),
        ("extensions:OtherTable", "its table has .* expected the columns of schema SYNERGIES"),
        ("extensions:TakenName", "the name 'aft' is taken by hrclog.analyzers.synergy.aft:Aft"),
        ("extensions:Markdown", "found Markdown, expected hrclog.analyzers.synergy.estimator.Estimator"),
        ("extensions:Stranger", "a coefficient of task 'cook' by 'bob', expected tasks that were observed"),
        ("extensions:Wordy", "a synergy of '2.0', expected a number"),
        ("extensions:Quits", "it raised SystemExit"),
        ("extensions.py:Quits", "names a file; expected a module, extensions:Quits"),
        ("extensions:Missing", "extensions has no 'Missing'"),
        ("no_such_module:X", "cannot be imported .*No module named 'no_such_module'"),
        ("median", "estimator is 'median', expected one of aft, bayes, ols, paper"),
    ],
)
def test_what_is_wrong_with_an_estimator_is_one_clear_error(path: str, message: str) -> None:
    with pytest.raises(HrclogError, match=message):
        hrclog.analyze(SAMPLES / "single.mcap", estimator=path)


def test_errors_of_an_estimator_are_no_tracebacks(run: Run, tmp_path: Path) -> None:
    broken = run("analyze", SAMPLES / "single.mcap", "-o", tmp_path, "--estimator", "extensions:Broken")
    assert broken.code == 1
    assert broken.err.startswith("hrclog: error: estimator 'broken': it raised ZeroDivisionError")
    unknown = run("analyze", SAMPLES / "single.mcap", "-o", tmp_path, "--estimator", "nobody:Knows")
    assert unknown.code == 2
    assert "No module named 'nobody'" in unknown.err


def test_a_class_that_workers_cannot_import_is_refused_before_the_draws() -> None:
    class Inner(extensions.MedianRatio):
        name = "inner"

    hrclog.register_estimator(Inner)
    with pytest.raises(HrclogError, match="estimator 'inner': it cannot be sent to worker processes"):
        hrclog.analyze(CAMPAIGN, estimator="inner", bootstrap=40, workers=2)


def test_a_name_may_be_taken_once() -> None:
    hrclog.register_estimator(extensions.MedianRatio)
    hrclog.register_estimator(extensions.MedianRatio)  # as a notebook does that runs a cell again

    class Other(extensions.MedianRatio):
        pass

    with pytest.raises(PluginError, match="the name 'median-ratio' is taken by extensions:MedianRatio"):
        hrclog.register_estimator(Other)


@pytest.mark.parametrize("name", ["", "two words", "a:b", None])
def test_a_name_is_a_name(name: object) -> None:
    named = type("Named", (extensions.MedianRatio,), {"name": name})
    with pytest.raises(PluginError, match="expected letters, digits"):
        hrclog.register_estimator(named)


def test_a_table_whose_entries_cannot_be_added_to_offers_no_path() -> None:
    table: Registry[hrclog.Estimator] = Registry("thing", "", "hrclog.analyzers.synergy.estimator:Estimator", {})
    with pytest.raises(PluginError) as caught:
        table["x"]
    assert "package.module" not in str(caught.value)


def test_a_class_in_the_working_folder_is_found_by_the_installed_command(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
    [code] = [block for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "class Diary" in block]
    (tmp_path / "diary_importer.py").write_text(code)
    (tmp_path / "diary.csv").write_text("monday,human,place,1000.0,1003.0\n")
    script = Path(sys.executable).parent / "hrclog"
    command = [str(script), "import", "diary_importer:Diary", "diary.csv", "-o", "diaries"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert read_logs(tmp_path / "diaries").events.height == 4


def test_a_knowledge_base_warns_of_factors_that_no_duration_can_have(run: Run, tmp_path: Path) -> None:
    updated = run("kb", "update", CAMPAIGN, "--kb", tmp_path / "kb.sqlite", "--estimator", "extensions:Negative")
    assert updated.code == 0
    assert "negative gives a factor of -3.00" in updated.err


@pytest.mark.parametrize(
    ("events", "message"),
    [
        (lambda _: [], "events of run 'monday': none, expected events"),
        (lambda _: ["x"], "events of run 'monday': an entry of type str"),
        (lambda _: None, "events of run 'monday': TypeError"),
        (lambda _: 1 / 0, "events of run 'monday': ZeroDivisionError"),
    ],
)
def test_events_that_an_importer_cannot_mean_are_one_clear_error(
    events: Callable[[str], Any], message: str, tmp_path: Path
) -> None:
    class Odd(Importer):
        name = "odd"
        summary = "Import nothing."

        def read(self, _sources: Sequence[Path], **_: object) -> Foreign:
            return Foreign(["monday"], events, 1)

    with pytest.raises(ImportDataError, match=message):
        import_files(Odd(), [tmp_path / "a.csv"], tmp_path / "logs")
    assert not (tmp_path / "logs").exists()


@pytest.mark.parametrize("estimator", [None, 5, hrclog.Estimator])
def test_an_estimator_is_named(estimator: object) -> None:
    with pytest.raises(PluginError, match=r"expected the name of one, or package\.module:NAME"):
        hrclog.analyze(SAMPLES / "failures.mcap", estimator=estimator)  # type: ignore[arg-type]  # what a user may try
