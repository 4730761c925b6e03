"""What commands say of a task that never succeeds and disturbs all the same."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from failing_cells import SCAN_WHILE_SCREW, SCREW_WHILE_SCAN, cell, write_cell

from hrclog.analyzers.synergy.estimators import ESTIMATORS

Run = Callable[..., Any]


@pytest.fixture(scope="module")
def failing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return logs of runs in which every scan fails."""
    return write_cell(tmp_path_factory.mktemp("failing") / "logs", cell(lambda _: "failed"))


@pytest.fixture(scope="module")
def succeeding(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return logs of other runs, in which every scan succeeds."""
    rows = [one | {"run_id": f"good-{one['run_id']}"} for one in cell(lambda _: "succeeded")]
    return write_cell(tmp_path_factory.mktemp("succeeding") / "logs", rows)


def test_the_summary_says_what_disturbed_what_was_not_told_and_what_never_overlapped(
    run: Run, failing: Path, tmp_path: Path
) -> None:
    out = run("analyze", failing, "-o", tmp_path, "--recordings", "0").out
    assert re.search(r"human: screw +robot: scan +1\.3\d +\[1\.3\d, 1\.3\d\].* 24 +19\d\.\d +ok\n", out)
    assert re.search(r"robot: scan +human: screw +n/a +\[n/a, n/a\] +n/a +24 +19\d\.\d +no_success\n", out)
    assert "1 pair of tasks overlapped, but the first never succeeded then (no_success): no factor is told\n" in out
    assert "2 pairs of tasks never overlapped: not observed\n" in out


@pytest.mark.slow
@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_synergies_and_overlaps_of_one_result_agree(run: Run, failing: Path, tmp_path: Path, estimator: str) -> None:
    found = run("analyze", failing, "-o", tmp_path, "--recordings", "0", "--estimator", estimator, "--json").json()
    names = ("agent", "task", "other_agent", "other_task")
    synergies, overlaps = (
        {tuple(one[name] for name in names): one for one in found[table]} for table in ("synergies", "overlaps")
    )
    for key in (SCREW_WHILE_SCAN, SCAN_WHILE_SCREW):
        assert synergies[key]["n"] == overlaps[key]["n"] == 24
        assert synergies[key]["overlap_s"] == pytest.approx(overlaps[key]["overlap_s"])
    assert (synergies[SCREW_WHILE_SCAN]["status"], synergies[SCAN_WHILE_SCREW]["status"]) == ("ok", "no_success")


@pytest.mark.slow
def test_a_comparison_shows_the_same_factor_beside_failures(run: Run, failing: Path, succeeding: Path) -> None:
    arguments = ("compare", succeeding, failing, "--bootstrap", "40")
    rows = run(*arguments, "--json").json()["synergies"]
    [row] = [one for one in rows if (one["task"], one["other_task"]) == ("screw", "scan")]
    assert (row["ratio"], row["n_a"], row["n_b"], row["runs_a"], row["runs_b"]) == (pytest.approx(1.0), 24, 24, 6, 6)
    [row] = [one for one in rows if (one["task"], one["other_task"]) == ("scan", "screw")]
    assert (row["status_b"], row["n_b"], row["runs_b"], row["ratio"]) == ("no_success", 24, 6, None)
    out = run(*arguments).out
    assert "| no_success" in out
    assert "2 pairs of tasks overlapped on one side or none: nothing to compare" in out


@pytest.mark.slow
def test_a_knowledge_base_keeps_factor_and_status(run: Run, failing: Path, tmp_path: Path) -> None:
    base = tmp_path / "kb.sqlite"
    assert run("kb", "update", failing, "--kb", base).code == 0
    out = run("kb", "show", "--kb", base).out
    assert re.search(r"human screw +robot scan +1\.3\d .* 24 +ok\n", out)
    assert re.search(r"robot scan +human screw +n/a +n/a +n/a +24 +no_success\n", out)


@pytest.mark.slow
def test_the_report_says_it_in_findings_and_pictures(run: Run, failing: Path, tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    assert run("report", failing, "-o", page, "--runs", "0").code == 0
    text = page.read_text(encoding="utf-8")
    assert "1 pair of tasks overlapped, but the first never succeeded then, so that no factor is told" in text
    assert re.search(r"robot: scan while human: screw runs \(n\s=\s24, 19", text)
    assert "2 of 4 ordered pairs of tasks never overlapped: nothing is known of them." in text
