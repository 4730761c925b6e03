"""Recordings: what is in them, that they are the same twice, and that names and empty data do no harm."""

from __future__ import annotations

import gc
import subprocess
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from hrclog.analyzers.analysis import analyze
from hrclog.analyzers.figures import CampaignFigures, RunFigures, campaign_figures, run_figures
from hrclog.analyzers.projections.schemas import DURATIONS, INTERVALS, PAIR_OVERLAPS, RUNS, SIGNALS, SYNERGIES
from hrclog.analyzers.rerun.save import save_campaign, save_run
from hrclog.diagnostic import Diagnostic
from hrclog.errors import OutputError
from hrclog.events import COLUMNS, FLOAT_COLUMNS, INT_COLUMNS, LATEST_NS

pytestmark = pytest.mark.slow

S = 1_000_000_000
ORIGIN = 1_700_000_000 * S
LATEST = LATEST_NS // S * S
INTS = {*INT_COLUMNS, "schema_version", "attempt", "seq"}
EVENTS = pl.Schema(
    {name: pl.Float64 if name in FLOAT_COLUMNS else pl.Int64 if name in INTS else pl.String for name in COLUMNS}
)
HOSTILE = ("a/b *c* \\", "机器人", "R\u202eö\n", "__properties", "..", "q\"'$x", "x" * 300, " ", "")


def execution(agent: str, task: str, start: int, end: int, **fields: object) -> dict[str, object]:
    row: dict[str, object] = {name: "" if kind == pl.String else None for name, kind in INTERVALS.items()}
    row |= {"run_id": "run-1", "agent": agent, "task": task, "role": "primary", "attempt": 1, "outcome": "succeeded"}
    row |= {"execution_id": f"{agent}{task}{start}", "start_ns": ORIGIN + start * S, "end_ns": ORIGIN + end * S}
    return row | {"until_ns": ORIGIN + end * S, "paused_ns": 0} | fields


def event(kind: str, time: int, **fields: object) -> dict[str, object]:
    blank = {name: "" if dtype == pl.String else None for name, dtype in EVENTS.items()}
    return blank | {"kind": kind, "time_ns": ORIGIN + time * S} | fields


def run_of(
    rows: list[dict[str, object]], log: list[dict[str, object]], signals: pl.DataFrame | None = None
) -> RunFigures:
    run = dict.fromkeys(RUNS, None) | {"run_id": "run-1", "name": "first run", "path": "a.mcap", "agents": ["H", "R"]}
    run |= {"makespan_s": 12.0, "n_executions": len(rows), "n_failed": 1, "n_open": 0, "outcome": "succeeded"}
    return run_figures(
        run,
        pl.DataFrame(rows, schema=INTERVALS, orient="row"),
        pl.DataFrame(log, schema=EVENTS, orient="row"),
        SIGNALS.to_frame() if signals is None else signals,
    )


@pytest.fixture
def run_pictures() -> RunFigures:
    rows = [
        execution("H", "pick", 1, 5),
        execution("H", "pick", 5, 8),
        execution("R", "weld", 2, 6, outcome="failed", planned_start_ns=ORIGIN + S, planned_end_ns=ORIGIN + 4 * S),
    ]
    log = [
        event("run_started", 0),
        event("safety_state_changed", 3, agent="R", mode="protective_stop", speed_scale=0.0),
        event("safety_state_changed", 4, agent="R", mode="normal", speed_scale=1.0),
        event("task_ended", 6, agent="R", task="weld", outcome="failed", reason="spatter"),
    ]
    signals = pl.DataFrame([("run-1", "gap", ORIGIN + at * S, at / 2) for at in range(9)], SIGNALS, orient="row")
    return run_of(rows, log, signals)


def campaign_of(agents: tuple[str, ...], tasks: tuple[str, ...]) -> CampaignFigures:
    """Return a campaign in which every task of an agent ran once; the synergy of the first pair is unobserved."""
    rows = [execution(agent, task, 10 * at, 10 * at + 3 + at) for agent in agents for at, task in enumerate(tasks)]
    keys = [
        {"agent": one, "task": task, "other_agent": other, "other_task": with_, "estimator": "aft"}
        for one in agents
        for other in agents
        if one != other
        for task in tasks
        for with_ in tasks
    ]
    known = {
        "synergy": 1.25,
        "ci_low": 1.0,
        "ci_high": 1.5,
        "n": 7,
        "overlap_s": 3.0,
        "mean_ratio": 0.5,
        "status": "ok",
    }
    unknown = dict.fromkeys(known) | {"n": 0, "overlap_s": 0.0, "mean_ratio": 0.0, "status": "unobserved"}
    pairs = [key | (unknown if key["task"] == key["other_task"] == tasks[0] else known) for key in keys]
    tabled = [
        dict.fromkeys(DURATIONS) | {"agent": agent, "task": task, "count": 1} for agent in agents for task in tasks
    ]
    run = dict.fromkeys(RUNS) | {"run_id": "run-1", "name": "first", "path": "a.mcap", "agents": list(agents)}
    cut = lambda schema: pl.DataFrame(  # noqa: E731 - used twice, just below
        [{name: pair.get(name) for name in schema} for pair in pairs], schema=schema, orient="row"
    )
    return campaign_figures(
        pl.DataFrame(rows, schema=INTERVALS, orient="row"),
        cut(PAIR_OVERLAPS),
        pl.DataFrame(tabled, schema=DURATIONS, orient="row"),
        cut(SYNERGIES),
        pl.DataFrame([run], schema=RUNS, orient="row"),
        [Diagnostic("one_agent", "a message | with a bar")],
    )


def columns(path: Path, entity: str) -> dict[str, list[object]]:
    """Return the columns logged on an entity, static ones among them, unpacked."""
    found: dict[str, list[object]] = {}
    for chunk in RrdReader(path).stream().filter(content=entity):
        for name, values in chunk.to_record_batch().to_pydict().items():
            found.setdefault(name.rpartition(":")[2], []).extend(values)
    return found


def flat(values: list[list[object]] | list[object]) -> list[object]:
    return [item for value in values for item in (value if isinstance(value, list) else [value])]


def entities(path: Path) -> set[str]:
    return {chunk.entity_path for chunk in RrdReader(path).stream()}


def rerun(*arguments: str | Path) -> int:
    # the script beside the interpreter: `python -m rerun_cli` always exits 0
    command = [str(Path(sys.executable).parent / "rerun"), "rrd", *map(str, arguments)]
    return subprocess.run(command, check=False, capture_output=True, timeout=120).returncode


def test_a_lane_reads_back_as_the_intervals_that_were_logged(run_pictures: RunFigures, tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    save_run(run_pictures, path)
    lane = columns(path, "/timeline/H/done")
    times = [round(time.total_seconds()) for time in lane["run_time"]]
    assert times == [1, 5, 5, 8]
    assert flat(lane["state"]) == ["pick", "", "pick", ""]
    failed = columns(path, "/timeline/R/done")
    assert flat(failed["state"]) == ["✗ weld failed", ""]
    assert flat(failed["labels"]) == ["✗ weld failed"]
    assert flat(columns(path, "/timeline/R/planned")["state"]) == ["weld", ""]
    safety = columns(path, "/timeline/R/safety")
    assert flat(safety["state"]) == ["protective stop, 0% speed", "", "normal, 100% speed", ""]
    assert [round(time.total_seconds()) for time in safety["run_time"]] == [3, 4, 4, 8]


def test_signals_events_and_tasks_read_back(run_pictures: RunFigures, tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    save_run(run_pictures, path)
    assert flat(columns(path, "/signals/signals/gap")["scalars"]) == [at / 2 for at in range(9)]
    assert flat(columns(path, r"/signals/speed\ scale/R")["scalars"]) == [0.0, 1.0, 1.0]
    log = columns(path, "/events")
    assert flat(log["text"])[-1] == "task ended: R weld (failed, spatter)"
    assert flat(log["level"]) == ["INFO", "WARN", "WARN", "ERROR"]
    tasks = columns(path, "/tasks/rows")
    assert flat(tasks["task"]) == ["pick", "weld", "pick"]
    assert flat(tasks["duration_s"]) == [4.0, 4.0, 3.0]
    assert flat(columns(path, "/__properties/run")["makespan_s"]) == [12.0]
    recording = RrdReader(path).recordings()[0]
    assert (recording.application_id, recording.recording_id) == ("hrclog first run", "run-1")
    properties = columns(path, "/__properties")
    assert flat(properties["name"]) == ["first run"]
    assert flat(properties["start_time"]) == [ORIGIN]


def test_a_campaign_reads_back_with_its_matrices_and_tables(tmp_path: Path) -> None:
    path = tmp_path / "campaign.rrd"
    save_campaign(campaign_of(("H", "R"), ("pick", "place")), path)
    values = columns(path, "/synergy/H/R/values")["data"][0][0]
    matrix = np.array(values["buffer"], np.float64).reshape(values["shape"])
    np.testing.assert_array_equal(matrix, [[np.nan, 1.25], [1.25, 1.25]])
    seconds = columns(path, "/overlap/seconds/R/H/values")["data"][0][0]
    assert list(seconds["buffer"]) == [0.0, 3.0, 3.0, 3.0]
    labels = flat(columns(path, "/coefficients/H/R/picture/points")["labels"])
    assert labels[0] == "pick | place: 1.250 (95 % 1.000 to 1.500), n = 7, ok"
    assert len(labels) == 3
    boxes = flat(columns(path, "/durations/all/picture/boxes")["labels"])
    assert boxes[0] == "H, pick: median 3.000 s, quartiles 3.000 to 3.000 s, mean 3.000 s, n = 1"
    rows = columns(path, "/tables/synergies/rows")
    assert flat(rows["synergy"])[:2] == [None, 1.25]
    assert "start_time" not in columns(path, "/__properties")  # it would be the time of rendering
    text = str(flat(columns(path, "/tables/diagnostics/text")["text"])[0])
    assert r"| info | one\_agent | a message \| with a bar |" in text


def test_synergies_over_runs_read_back_as_a_picture_per_step(tmp_path: Path) -> None:
    analysis = analyze(Path(__file__).parents[3] / "sample_logs" / "campaign")
    figures = analysis.campaign_figures()
    save_campaign(figures, tmp_path / "campaign.rrd")
    (page,) = [page for page in figures.pages if page.steps]
    assert len(page.steps) == 2
    for steps in page.steps:
        path = "/" + "/".join(part.replace(" ", "\\ ") for part in steps.plots[0].path)
        read = columns(tmp_path / "campaign.rrd", f"{path}/picture")
        assert tuple(read["runs"]) == steps.numbers == (1, 2, 5, 12)
        assert len(read["blob"]) == 4
        assert read["blob"][0] != read["blob"][-1]
    assert rerun("verify", tmp_path / "campaign.rrd") == 0


def test_two_renderings_are_equal_and_verify(run_pictures: RunFigures, tmp_path: Path) -> None:
    campaign = campaign_of(("H", "R"), ("pick", "place"))
    for name in ("one", "two"):
        save_run(run_pictures, tmp_path / f"{name}_run.rrd")
        save_campaign(campaign, tmp_path / f"{name}_campaign.rrd")
    for kind in ("run", "campaign"):
        one, two = (tmp_path / f"{name}_{kind}.rrd" for name in ("one", "two"))
        assert rerun("verify", one) == 0
        assert rerun("compare", "--unordered", one, two) == 0
    assert rerun("compare", "--unordered", tmp_path / "one_run.rrd", tmp_path / "one_campaign.rrd") != 0


def test_a_recording_carries_its_layout(run_pictures: RunFigures, tmp_path: Path) -> None:
    save_run(run_pictures, tmp_path / "run.rrd")
    reader = RrdReader(tmp_path / "run.rrd")
    (layout,) = reader.blueprints()
    name = "ViewBlueprint:class_identifier"
    batches = [chunk.to_record_batch() for chunk in reader.stream(store=layout)]
    views = {batch.column(name)[0][0].as_py() for batch in batches if name in batch.schema.names}
    assert views == {"StateTimeline", "TimeSeries", "TextLog", "Dataframe", "TextDocument"}


def test_hostile_names_stay_apart_and_whole(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    rows = [execution(agent, agent, at, at + 1) for at, agent in enumerate(HOSTILE)]
    save_run(run_of(rows, [event("task_started", 0, agent=agent, task=agent) for agent in HOSTILE]), path)
    lanes = {entity for entity in entities(path) if entity.startswith("/timeline/")}
    assert len(lanes) == len(HOSTILE)
    assert r"/timeline/\(unnamed\)/done" in lanes
    assert r"/timeline/a\/b\ \*c\*\ \\_/done" in lanes
    assert set(flat(columns(path, "/tasks/rows")["agent"])) == set(HOSTILE)
    assert rerun("verify", path) == 0


def test_hostile_names_do_no_harm_to_a_campaign(tmp_path: Path) -> None:
    path = tmp_path / "campaign.rrd"
    save_campaign(campaign_of(HOSTILE[:3], HOSTILE), path)
    assert (
        len([entity for entity in entities(path) if entity.startswith("/synergy/") and entity.endswith("/picture")])
        == 6
    )
    assert rerun("verify", path) == 0


def test_nothing_at_all_makes_a_recording_that_says_so(tmp_path: Path) -> None:
    run, campaign = tmp_path / "run.rrd", tmp_path / "campaign.rrd"
    save_run(run_of([], []), run)
    save_campaign(
        campaign_figures(
            INTERVALS.to_frame(),
            PAIR_OVERLAPS.to_frame(),
            DURATIONS.to_frame(),
            SYNERGIES.to_frame(),
            RUNS.to_frame(),
            [],
        ),
        campaign,
    )
    assert rerun("verify", run) == rerun("verify", campaign) == 0
    assert "Nothing to list." in str(flat(columns(run, "/tasks/text")["text"])[0])
    assert "No two agents" in str(flat(columns(campaign, "/about")["text"])[0])


def test_a_folder_that_is_not_there_is_one_clear_error(run_pictures: RunFigures, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"nowhere.*cannot be written"):
        save_run(run_pictures, tmp_path / "nowhere" / "run.rrd")


def test_a_folder_that_is_not_there_is_said_by_us_alone(
    run_pictures: RunFigures, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(OutputError):
        save_run(run_pictures, tmp_path / "nowhere" / "run.rrd")
    gc.collect()
    assert capfd.readouterr() == ("", "")


@pytest.mark.skipif(sys.platform == "win32", reason="limits the size of files as POSIX does")
def test_a_disk_that_fills_up_in_the_middle_is_an_error(tmp_path: Path) -> None:
    log = Path(__file__).parents[3] / "sample_logs" / "single.mcap"
    code = (
        "import resource, sys; from hrclog.analyzers.analysis import analyze; result = analyze(sys.argv[1]);"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (8000, 8000)); result.to_rerun(sys.argv[2])"
    )
    command = [sys.executable, "-c", code, str(log), str(tmp_path / "all.rrd")]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=120)
    assert done.returncode == 1
    assert "OutputError" in done.stderr
    assert "all.rrd: cannot be written" in done.stderr


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="counts threads as Linux does")
def test_many_recordings_leave_no_threads_behind(run_pictures: RunFigures, tmp_path: Path) -> None:
    campaign = campaign_of(("H", "R"), ("pick",))
    save_run(run_pictures, tmp_path / "first.rrd")
    before = len(list(Path("/proc/self/task").iterdir()))
    for number in range(10):
        save_run(run_pictures, tmp_path / f"{number}.rrd")
        save_campaign(campaign, tmp_path / f"{number}_campaign.rrd")
    assert len(list(Path("/proc/self/task").iterdir())) <= before + 3


@pytest.mark.parametrize("origin", [-LATEST, 0])
def test_the_longest_times_that_a_log_may_hold_are_drawn(origin: int, tmp_path: Path) -> None:
    times = {"start_ns": origin, "end_ns": LATEST, "until_ns": LATEST}
    planned = {"planned_start_ns": -LATEST, "planned_end_ns": LATEST}
    rows = [execution(agent, "pick", 0, 1) | times | planned for agent in ("H", "R")]
    rows.append(execution("H", "place", 0, 1) | times | {"paused_ns": LATEST - origin})
    log = [event("task_started", 0, agent="H") | {"time_ns": at} for at in (origin, LATEST)]
    log.append(event("safety_state_changed", 0, agent="R", speed_scale=0.5) | {"time_ns": origin})
    signals = pl.DataFrame([("run-1", "gap", at, 1.0) for at in (origin, LATEST)], SIGNALS, orient="row")
    save_run(run_of(rows, log, signals), tmp_path / "run.rrd")
    assert rerun("verify", tmp_path / "run.rrd") == 0
    bars = columns(tmp_path / "run.rrd", "/timeline/H/done")["run_time"]
    assert [time.total_seconds() * S for time in bars] == [0, LATEST - origin]


def test_only_the_rerun_modules_know_rerun() -> None:
    root = Path(__file__).parents[3]
    knowing = {
        str(path.relative_to(root))
        for room in ("analyzers", "recorders", "sim", "hrclog")
        for path in (root / room).rglob("*.py")
        if path.resolve() == root.resolve() / path.relative_to(root)
        for line in path.read_text(encoding="utf-8").splitlines()
        if line.lstrip().startswith(("import rerun", "from rerun"))
    }
    folder = "analyzers/rerun"
    own = {f"{folder}/{name}.py" for name in ("save", "cell", "layout", "recording")}
    assert knowing == {*own, "analyzers/live/streams.py"}


def test_what_holds_until_the_next_sample_is_drawn_as_steps(run_pictures: RunFigures, tmp_path: Path) -> None:
    save_run(run_pictures, tmp_path / "run.rrd")
    scale, gap = (columns(tmp_path / "run.rrd", path) for path in (r"/signals/speed\ scale/R", "/signals/signals/gap"))
    ways = rr.components.InterpolationMode
    assert flat(scale["interpolation_mode"]) == [ways.StepAfter.value]
    assert flat(gap["interpolation_mode"]) == [ways.Linear.value]
