"""Every view of every kind of campaign, in a real viewer: all show, none complains."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import pytest
from picture_campaigns import UNICODE, apart, many_tasks
from rerun_viewers import colours, complaints, show, tabs, viewer_in, virtual_display

from hrclog.analyzers.analysis import analyze
from hrclog.recorders.importers.mongo import import_mongo

SAMPLES = Path(__file__).parents[2] / "sample_logs"

pytestmark = pytest.mark.slow


BOTH = ("campaign", "run")


def seen(logs: Path, folder: Path, size: str, display: str = "", *, of: Sequence[str] = BOTH) -> int:
    """Look at every tab of a campaign and of its first run; return how many there are."""
    analysis = analyze(logs)
    analysis.to_rerun(folder / "campaign.rrd")
    analysis.run_to_rerun(analysis.runs["run_id"][0], folder / "run.rrd")
    count = 0
    for name in of:
        with viewer_in(folder, size, display) as viewer:
            show(viewer, folder / f"{name}.rrd")
            assert colours(viewer, folder / f"{name}.png", size) > 100
            for tab in tabs(viewer):
                count += 1
                assert complaints(viewer) == [], (name, tab)
    return count


def test_a_campaign_of_two_agents(tmp_path: Path) -> None:
    assert seen(SAMPLES / "campaign", tmp_path, "1000x700") >= 20


def test_three_agents(tmp_path: Path) -> None:
    assert seen(SAMPLES / "three_agents.mcap", tmp_path, "1000x700") >= 20


def test_a_run_with_failures(tmp_path: Path) -> None:
    assert seen(SAMPLES / "failures.mcap", tmp_path, "1000x700") >= 10


def test_a_run_of_the_cell(tmp_path: Path) -> None:
    assert seen(SAMPLES / "cell_areas.mcap", tmp_path, "1000x700") >= 10


def test_agents_that_never_work_at_once(tmp_path: Path) -> None:
    apart(tmp_path / "logs")
    assert seen(tmp_path / "logs", tmp_path, "1000x700") >= 10


def test_sixty_tasks_per_agent_with_names_in_many_scripts(tmp_path: Path) -> None:
    """The headless viewer panics at a glyph that its own font lacks; one with a window takes the system's fonts."""
    if shutil.which("Xvfb") is None:
        pytest.skip("no Xvfb, which a viewer with a window needs here: apt-get install xvfb")
    many_tasks(tmp_path / "logs", UNICODE)
    with virtual_display() as display:
        assert seen(tmp_path / "logs", tmp_path, "1000x700", display) >= 10


def test_the_51_runs_of_the_authors(tmp_path: Path, data_dir: Path) -> None:
    import_mongo([data_dir / "safety_areas" / "task_results.json"], tmp_path / "logs")
    assert seen(tmp_path / "logs", tmp_path, "1600x1000") >= 20


def test_the_200_runs_of_four_planners(tmp_path: Path, data_dir: Path) -> None:
    """A single one of them looks like one of the 51."""
    import_mongo([data_dir / "safety_areas" / "task_results_online.json"], tmp_path / "logs")
    assert seen(tmp_path / "logs", tmp_path, "1600x1000", of=["campaign"]) >= 10
