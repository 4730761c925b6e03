"""The recordings in a real viewer, without a window: every view shows, and none of them complains."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import rerun as rr
import rerun.blueprint as rrb
from cell_logs import RUN as CELL_RUN
from cell_logs import write_cell_log
from PIL import Image
from rerun.experimental import ViewerClient
from rerun_viewers import colours, complaints, show, state_of, tabs

from hrclog.analyzers.analysis import analyze
from hrclog.analyzers.figures import campaign_figures, run_figures
from hrclog.analyzers.projections.schemas import DURATIONS, INTERVALS, PAIR_OVERLAPS, RUNS, SIGNALS, SYNERGIES
from hrclog.analyzers.rerun.save import save_campaign, save_run
from hrclog.events import COLUMNS, FLOAT_COLUMNS, INT_COLUMNS

S = 1_000_000_000
pytestmark = pytest.mark.slow


def interval(agent: str, task: str, start: int, end: int, outcome: str = "succeeded") -> dict[str, object]:
    row: dict[str, object] = {name: "" if kind == pl.String else None for name, kind in INTERVALS.items()}
    row |= {"run_id": "run-1", "agent": agent, "task": task, "role": "primary", "attempt": 1, "outcome": outcome}
    row |= {"execution_id": f"{agent}{start}", "start_ns": start * S, "end_ns": end * S, "until_ns": end * S}
    return row | {"planned_start_ns": start * S, "planned_end_ns": end * S, "paused_ns": 0}


ROWS = pl.DataFrame(
    [
        interval("H", "pick", 0, 5),
        interval("H", "place", 6, 9),
        interval("R", "weld", 2, 6, "failed"),
        interval("R", "weld", 6, 8),
    ],
    schema=INTERVALS,
    orient="row",
)
RUN = dict.fromkeys(RUNS) | {"run_id": "run-1", "name": "a run", "path": "a.mcap", "agents": ["H", "R"], "outcome": ""}


def test_a_broken_picture_behind_tabs_within_tabs_is_found(viewer: ViewerClient, tmp_path: Path) -> None:
    recording = rr.RecordingStream("broken")
    recording.save(tmp_path / "broken.rrd")
    recording.log("whole", rr.Boxes2D(sizes=[[1, 1]]), static=True)
    recording.log("broken", rr.EncodedImage(contents=b"no picture", media_type="image/png"), static=True)
    first, second, third = (rrb.Spatial2DView(origin=name) for name in ("/whole", "/whole", "/broken"))
    recording.send_blueprint(rrb.Blueprint(rrb.Tabs(first, rrb.Tabs(second, third))))
    recording.flush()
    show(viewer, tmp_path / "broken.rrd")
    assert complaints(viewer) == []
    found = ["picture" in str(complaints(viewer)) for _ in tabs(viewer)]
    assert len(found) == 3
    assert any(found)


def test_every_view_of_a_run_shows_without_complaint(viewer: ViewerClient, tmp_path: Path) -> None:
    ints = {*INT_COLUMNS, "schema_version", "attempt", "seq"}
    kinds = {name: pl.Float64 if name in FLOAT_COLUMNS else pl.Int64 if name in ints else pl.String for name in COLUMNS}
    blank = {name: "" if kind == pl.String else None for name, kind in kinds.items()}
    log = [
        blank | {"kind": "run_started", "time_ns": 0},
        blank | {"kind": "safety_state_changed", "time_ns": 3 * S, "agent": "R", "mode": "stop", "speed_scale": 0.0},
        blank | {"kind": "safety_state_changed", "time_ns": 4 * S, "agent": "R", "mode": "normal", "speed_scale": 1.0},
    ]
    signals = pl.DataFrame([("run-1", "gap", at * S, at / 2) for at in range(9)], SIGNALS, orient="row")
    figures = run_figures(RUN, ROWS, pl.DataFrame(log, schema=pl.Schema(kinds), orient="row"), signals)
    save_run(figures, tmp_path / "run.rrd")
    show(viewer, tmp_path / "run.rrd")
    seen = {view.view_class for view in state_of(viewer).views}
    assert seen == {"StateTimeline", "TimeSeries", "TextLog", "Dataframe", "TextDocument"}
    (recording,) = state_of(viewer).recordings
    assert (recording.current_timeline, recording.current_time) == ("run_time", 0)
    assert colours(viewer, tmp_path / "run.png") > 100
    assert [complaints(viewer) for _ in tabs(viewer)] == [[]] * 4


def test_a_cell_is_seen_beside_its_timeline_without_complaint(viewer: ViewerClient, tmp_path: Path) -> None:
    write_cell_log(tmp_path / "cell.mcap")
    analyze(tmp_path / "cell.mcap").run_to_rerun(CELL_RUN, tmp_path / "cell.rrd")
    show(viewer, tmp_path / "cell.rrd")
    (cell,) = [view.view_id for view in state_of(viewer).views if view.view_class == "3D"]
    orange, red = [], []
    for at in (0.0, 2.5, 3.5):
        viewer.set_time("run_time", duration=at, play_state="paused")
        time.sleep(1)
        viewer.save_screenshot(str(tmp_path / "cell.png"), view_id=cell)
        with Image.open(tmp_path / "cell.png") as image:
            pixels = np.asarray(image.convert("RGB"), float)
        bright = (pixels[..., 0] > 110) & (pixels[..., 2] < pixels[..., 0] / 3)
        shares = pixels[bright][:, 1] / pixels[bright][:, 0]
        orange.append(bool((shares > 0.57).sum() > 8000))  # the rim of a dark area is orange too
        red.append(bool((shares < 0.57).sum() > 8000))
    assert (orange, red) == ([False, True, False], [False, False, True])
    assert [complaints(viewer) for _ in tabs(viewer)] == [[]] * 7


def test_every_view_of_a_campaign_shows_without_complaint(viewer: ViewerClient, tmp_path: Path) -> None:
    known = {"synergy": 1.2, "ci_low": 1.0, "ci_high": 1.4, "n": 6, "overlap_s": 3.0, "mean_ratio": 0.5, "status": "ok"}
    pairs = [
        {"agent": one, "task": task, "other_agent": other, "other_task": with_, "estimator": "aft"} | known
        for one, task, other, with_ in (
            ("H", "pick", "R", "weld"),
            ("H", "place", "R", "weld"),
            ("R", "weld", "H", "pick"),
            ("R", "weld", "H", "place"),
        )
    ]
    overlaps, synergies = (
        pl.DataFrame([{name: pair.get(name) for name in schema} for pair in pairs], schema=schema, orient="row")
        for schema in (PAIR_OVERLAPS, SYNERGIES)
    )
    tabled = [dict.fromkeys(DURATIONS) | {"agent": "H", "task": task, "count": 1} for task in ("pick", "place")]
    durations = pl.DataFrame(tabled, schema=DURATIONS, orient="row")
    runs = pl.DataFrame([RUN], schema=RUNS, orient="row")
    save_campaign(campaign_figures(ROWS, overlaps, durations, synergies, runs, []), tmp_path / "campaign.rrd")
    show(viewer, tmp_path / "campaign.rrd")
    seen = {view.view_class for view in state_of(viewer).views}
    assert seen == {"2D", "TextDocument"}
    assert colours(viewer, tmp_path / "campaign.png") > 100
    assert [complaints(viewer) for _ in tabs(viewer)] == [[]] * (6 + 5)
