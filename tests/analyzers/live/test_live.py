"""Runs that go on: whatever is drawn piece by piece is, in the end, the picture of the whole run."""

from __future__ import annotations

import os
import shutil
from bisect import bisect_right
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from cell_logs import write_cell_log
from event_frames import LEGAL, event, event_rows
from event_frames import frame as frame_of
from hypothesis import given, settings
from hypothesis import strategies as st

import hrclog
from hrclog.analyzers.analysis import analyze, analyze_logs
from hrclog.analyzers.figures import CampaignFigures, RunFigures, run_figures
from hrclog.analyzers.figures.events import event_lines, pauses
from hrclog.analyzers.figures.gantt import Lane, execution_lanes, state_changes
from hrclog.analyzers.live import follow as live
from hrclog.analyzers.live import journal as live_journal
from hrclog.analyzers.live.executions import LiveExecutions
from hrclog.analyzers.live.follow import Followed, follow
from hrclog.analyzers.live.lanes import LaneKey
from hrclog.analyzers.live.run import LivePart, LiveRun
from hrclog.analyzers.live.statistics import EndedRuns, Statistics
from hrclog.analyzers.projections.intervals import rebuild
from hrclog.analyzers.projections.runs import runs
from hrclog.analyzers.result import Analysis
from hrclog.errors import LogReadError
from hrclog.log.checks import usable
from hrclog.log.messages.message import EVENTS
from hrclog.log.messages.signals import SIGNAL_COLUMNS
from hrclog.log.one_log import read_annotated, read_log
from hrclog.log.recover import recover
from hrclog.log.writing.journal import journal_path
from hrclog.recorders.recorder import Recorder

SAMPLES = Path(__file__).parents[3] / "sample_logs"
S = 1_000_000_000
NO_SIGNALS = SIGNAL_COLUMNS.to_frame()

States = dict[int, str]
"""What a lane shows from each instant on."""


def frame(rows: Iterable[dict[str, Any]]) -> pl.DataFrame:
    return frame_of(rows).select(EVENTS.names())


def batches(events: pl.DataFrame, cuts: Iterable[int]) -> list[pl.DataFrame]:
    edges = [0, *sorted(cuts), events.height]
    return [events[start:end] for start, end in pairwise(edges) if end > start]


def said(parts: Iterable[LivePart]) -> dict[LaneKey, States]:
    """Return what lanes show: of what is said of one instant, the last counts."""
    lanes: dict[LaneKey, States] = {}
    for part in parts:
        for key, news in part.lanes.items():
            lanes.setdefault(key, {}).update(zip(news.times_ns, news.states, strict=True))
    return lanes


def shown(states: States, instants: Iterable[int]) -> list[str]:
    times = sorted(states)
    return [states[times[at - 1]] if (at := bisect_right(times, instant)) else "" for instant in instants]


def is_same(lanes: Mapping[LaneKey, States], expected: Iterable[Lane], kinds: tuple[str, ...]) -> None:
    """Assert that lanes show the bars of others at every instant, and that further lanes show none."""
    wanted = {(lane.agent, lane.kind, lane.number): dict(zip(*state_changes(lane), strict=True)) for lane in expected}
    for key in (key for key in {**lanes, **wanted} if key[1] in kinds):
        found, right = lanes.get(key, {}), wanted.get(key, {})
        instants = sorted({*found, *right})
        assert shown(found, instants) == shown(right, instants), key


def whole(events: pl.DataFrame) -> RunFigures:
    events = usable(events).sort("time_ns", "seq", maintain_order=True)
    executions, _ = rebuild(events)
    return run_figures(runs(events, executions).row(0, named=True), executions, events, NO_SIGNALS)


@settings(max_examples=12)
@given(rows=event_rows(), data=st.data())
def test_a_run_drawn_in_any_pieces_is_in_the_end_the_picture_of_the_whole_run(
    rows: list[dict[str, Any]], data: st.DataObject
) -> None:
    own = [row for row in rows if row["run_id"] == "r"]
    events = frame([event("run_started", 0, run_id="r"), *own])
    pieces = batches(events, data.draw(st.lists(st.integers(1, events.height), max_size=4)))
    run = LiveRun(pieces[0])
    parts = [run.part(run.latest_ns, alive=True)]
    for piece in pieces[1:]:
        run.take(piece)
        parts.append(run.part(run.latest_ns, alive=data.draw(st.booleans())))
    figures = whole(events)
    parts.append(run.last_part(figures))
    is_same(said(parts), figures.gantt.lanes, ("done", "planned", "safety"))
    lines = [text for part in parts for text in part.figures.events.texts]
    assert lines == list(event_lines(events, 0).texts)


@st.composite
def lives(draw: st.DrawFn) -> pl.DataFrame:
    """Draw the events of a few executions that break no rule, in the order of time, no two at one instant."""
    found: list[tuple[int, dict[str, Any]]] = []
    for number in range(draw(st.integers(1, 6))):
        agent, now = draw(st.sampled_from("AAB")), draw(st.integers(0, 20))
        facts = {"agent": agent, "task": f"t{number % 3}", "execution_id": f"e{number}"}
        for kind in draw(st.sampled_from(LEGAL)):
            outcome = draw(st.sampled_from(("succeeded", "failed"))) if kind == "task_ended" else ""
            found.append((now, event(kind, 0, **facts, **({"outcome": outcome} if outcome else {}))))
            now += draw(st.integers(1, 6))
    found.sort(key=lambda one: one[0])
    return frame([event("run_started", 0)] + [row | {"time_ns": at * 10} for at, (_, row) in enumerate(found, 1)])


@settings(max_examples=12)
@given(events=lives(), data=st.data())
def test_at_every_look_the_lanes_are_those_of_all_that_was_told_so_far(
    events: pl.DataFrame, data: st.DataObject
) -> None:
    pieces = batches(events, data.draw(st.lists(st.integers(1, events.height), max_size=4)))
    run = LiveRun(pieces[0])
    parts: list[LivePart] = []
    for number in range(len(pieces)):
        if number:
            run.take(pieces[number])
        now_ns = run.latest_ns + 5
        parts.append(run.part(now_ns, alive=True))
        told = pl.concat(pieces[: number + 1])
        executions, _ = rebuild(told)
        is_open = pl.col("end_ns").is_null()
        until = executions.with_columns(
            pl.when(is_open).then(pl.lit("succeeded")).otherwise("outcome").alias("outcome"),
            pl.when(is_open).then(now_ns).otherwise("end_ns").alias("end_ns"),
            pl.when(is_open).then(now_ns).otherwise("until_ns").alias("until_ns"),
        )
        gaps = pauses(told, now_ns)
        lanes = said(parts)
        for states in lanes.values():  # what is open has no end in a lane; here it ends now
            states.setdefault(now_ns, "")
        is_same(lanes, execution_lanes(until, gaps, 0), ("done",))
        facts = dict(parts[-1].figures.facts)
        assert facts["executions"] == executions.height
        assert facts["open"] == executions.filter(is_open).height
        assert facts["failed"] == executions.filter(pl.col("outcome") == "failed").height


def started(agent: str, task: str, at: int, **fields: object) -> dict[str, Any]:
    return event("task_started", at * S, agent=agent, task=task, execution_id=f"{agent}{task}", **fields)


def ended(agent: str, task: str, at: int, **fields: object) -> dict[str, Any]:
    return event("task_ended", at * S, agent=agent, task=task, execution_id=f"{agent}{task}", **fields)


def numbered(rows: list[dict[str, Any]], first: int) -> pl.DataFrame:
    return frame([row | {"seq": first + at} for at, row in enumerate(rows)])


def test_what_is_open_has_no_end_until_it_ends_and_takes_its_true_colours_then() -> None:
    run = LiveRun(frame([event("run_started", 0), started("A", "x", 1)]))
    first = run.part(3 * S, alive=True)
    assert said([first]) == {("A", "done", 0): {1 * S: "x"}}
    again = run.part(9 * S, alive=True)
    assert (again.lanes, again.now_ns) == ({}, 9 * S)
    assert again.rows.frame.is_empty()
    run.take(numbered([ended("A", "x", 10, outcome="failed")], 2))
    last = run.part(10 * S, alive=True)
    assert said([last]) == {("A", "done", 0): {1 * S: "✗ x failed", 10 * S: ""}}
    assert last.rows.frame["outcome"].to_list() == ["failed"]


def test_a_run_whose_recorder_has_gone_shows_what_is_open_up_to_its_last_word_and_goes_on_if_it_wakes() -> None:
    run = LiveRun(frame([event("run_started", 0), started("A", "x", 1), event("heartbeat", 4 * S)]))
    parts = [run.part(7 * S, alive=True), run.part(run.latest_ns, alive=False)]
    assert said(parts)["A", "done", 0] == {1 * S: "x still open", 4 * S: ""}
    assert dict(parts[-1].figures.facts)["outcome"] == "unfinished"
    run.take(numbered([event("heartbeat", 20 * S)], 3))
    parts.append(run.part(run.latest_ns, alive=True))
    assert shown(said(parts)["A", "done", 0], [2 * S, 4 * S, 20 * S]) == ["x", "x", "x"]


def test_the_future_of_a_plan_is_not_told_before_its_time() -> None:
    planned = {"planned_start_ns": 2 * S, "planned_end_ns": 8 * S}
    run = LiveRun(frame([event("run_started", 0), started("A", "x", 1, **planned)]))
    parts = [run.part(now * S, alive=True) for now in (1, 3, 9)]
    lanes = [said([part]).get(("A", "planned", 0)) for part in parts]
    assert lanes == [None, {2 * S: "x"}, {8 * S: ""}]


def test_plans_that_only_rounding_lets_overlap_share_a_lane() -> None:
    rows = [event("run_started", 0)]
    for task, start, end in (("x", 0, S + 300_000), ("y", S, 2 * S)):
        rows.append(started("A", task, len(rows), planned_start_ns=start, planned_end_ns=end))
    lanes = said([LiveRun(frame(rows)).part(5 * S, alive=True)])
    assert lanes["A", "planned", 0] == {0: "x", S + 300_000: "y", 2 * S: ""}


def test_what_an_agent_does_at_once_lies_in_lanes_of_its_own_until_there_is_room_again() -> None:
    run = LiveRun(frame([event("run_started", 0), started("A", "x", 1)]))
    parts = [run.part(2 * S, alive=True)]
    for first, rows in ((2, [started("A", "y", 3)]), (3, [ended("A", "x", 4), started("A", "z", 5)])):
        run.take(numbered(rows, first))
        parts.append(run.part(6 * S, alive=True))
    assert said(parts) == {
        ("A", "done", 0): {1 * S: "x", 4 * S: "", 5 * S: "z"},
        ("A", "done", 1): {3 * S: "y"},
    }


def test_the_plan_that_every_attempt_repeats_is_drawn_once() -> None:
    planned = {"planned_start_ns": 1 * S, "planned_end_ns": 2 * S}
    rows = [started("A", "x", 1, **planned), ended("A", "x", 2, outcome="failed")]
    again = [row | {"execution_id": "again", "attempt": 2, "time_ns": row["time_ns"] + 3 * S} for row in rows]
    lanes = said([LiveRun(frame([event("run_started", 0), *rows, *again])).part(9 * S, alive=True)])
    assert [key for key in lanes if key[1] == "planned"] == [("A", "planned", 0)]


def test_samples_are_drawn_once_and_held_lines_up_to_a_second_ago() -> None:
    safe = event("safety_state_changed", 2 * S, agent="A", mode="slow", speed_scale=0.5)
    run = LiveRun(frame([event("run_started", 0), started("A", "x", 0), started("B", "y", 0), safe]))
    signal = pl.DataFrame([("run", "gap", at * S, float(at)) for at in range(3)], SIGNAL_COLUMNS, orient="row")
    run.take(run_nothing(), signal)
    parts = [run.part(4 * S, alive=True), run.part(6 * S, alive=True)]
    lines = [{one.name: (one.times_ns / S).tolist() for one in part.figures.series} for part in parts]
    assert lines == [
        {"A": [2, 3], "gap": [0, 1, 2], "A and B": [0, 3]},
        {"A": [2, 5], "A and B": [5]},
    ]
    assert [one.name for one in parts[-1].outline.series] == ["A", "gap", "A and B"]


def run_nothing() -> pl.DataFrame:
    return frame([event("heartbeat", 0)]).clear()


@dataclass
class FakeRun:
    """Stands in for the recording of a run in a viewer."""

    figures: RunFigures
    recording_id: str
    names: list[str] = field(default_factory=list)
    parts: list[LivePart] = field(default_factory=list)
    whole: RunFigures | None = None
    closed: bool = False

    def send(self, part: LivePart) -> None:
        """Take what is new."""
        assert not self.closed
        self.parts.append(part)

    def send_whole(self, figures: RunFigures) -> None:
        """Take a run that is over."""
        self.whole = figures

    def name(self, name: str) -> None:
        """Remember a new name."""
        self.names += [name] if name not in self.names[-1:] else []

    def close(self) -> None:
        """Take nothing more."""
        self.closed = True


@dataclass
class Viewer:
    """What was shown."""

    runs: list[FakeRun] = field(default_factory=list)
    campaigns: list[CampaignFigures] = field(default_factory=list)
    told: list[str] = field(default_factory=list)

    def run(self, _url: str, figures: RunFigures, recording_id: str) -> FakeRun:
        """Return where a run is shown."""
        self.runs.append(FakeRun(figures, recording_id))
        return self.runs[-1]

    def campaign(self, _url: str, _recording_id: str) -> Viewer:
        """Return where all runs are shown."""
        return self

    def send(self, figures: CampaignFigures) -> None:
        """Take pictures."""
        self.campaigns.append(figures)

    def close(self) -> None:
        """Do nothing."""


@pytest.fixture
def viewer(monkeypatch: pytest.MonkeyPatch) -> Viewer:
    viewer = Viewer()
    monkeypatch.setattr(live, "RunStream", viewer.run)
    monkeypatch.setattr(live_journal, "RunStream", viewer.run)
    monkeypatch.setattr(live, "CampaignStream", viewer.campaign)
    return viewer


def watch(folder: Path, viewer: Viewer, *steps: Callable[[], object]) -> Followed:
    """Follow a folder; after each look comes a step, and after the last one so many that nothing is new."""
    left = list(steps)

    def wait(seconds: float) -> bool:
        if left and seconds:
            left.pop(0)()
        return False

    followed = Followed()
    until_idle_s = 0.3 * (1 + len(steps))  # on a busy machine a look may take longer than it should
    return follow(folder, "", wait, until_idle_s=until_idle_s, tell=viewer.told.append, followed=followed)


def nothing() -> None:
    """Let a look go by."""


def samples(folder: Path, count: int) -> list[Path]:
    folder.mkdir(exist_ok=True)
    return [Path(shutil.copy(path, folder)) for path in sorted((SAMPLES / "campaign").glob("*.mcap"))[:count]]


def facts(figures: RunFigures) -> dict[str, object]:
    return dict(figures.facts)


def test_earlier_runs_count_and_the_latest_three_are_drawn(viewer: Viewer, tmp_path: Path) -> None:
    paths = samples(tmp_path, 5)
    assert watch(tmp_path, viewer) == Followed()
    assert [run.figures.name for run in viewer.runs] == [path.stem for path in paths[2:]]
    assert all(run.whole is not None and run.closed for run in viewer.runs)
    assert viewer.told == ["2 earlier runs are in the statistics, not drawn: hrclog view FILE shows one"]
    assert [figures.name for figures in viewer.campaigns] == ["campaign of 5 runs"]


@pytest.mark.parametrize("is_annotated", [False, True])
def test_the_statistics_are_those_of_the_whole_folder(is_annotated: bool, tmp_path: Path) -> None:
    ended = EndedRuns()
    write_cell_log(tmp_path / "cell.mcap")
    shutil.copy(SAMPLES / "failures.mcap", tmp_path)
    paths = samples(tmp_path, 6)
    if is_annotated:
        hrclog.annotate(paths[:2], exclude=["run"], reason="rehearsals")
        hrclog.annotate(paths[2], exclude=["0..20"], not_learnt=["40.."], reason="a visitor")
    for path in sorted(tmp_path.iterdir()):
        if not path.name.endswith(".annotations.mcap"):
            ended.put(path, read_annotated(path, signals=True))
    found, expected = analyze_logs(ended.logs()), analyze(tmp_path)
    for name in ("intervals", "overlaps", "pair_overlaps", "durations", "synergies", "runs", "metrics"):
        assert getattr(found, name).equals(getattr(expected, name)), name
    assert found.diagnostics == expected.diagnostics


def test_what_annotations_exclude_is_neither_drawn_nor_counted(viewer: Viewer, tmp_path: Path) -> None:
    paths = samples(tmp_path, 3)
    hrclog.annotate(paths[2], exclude=["run"], reason="a rehearsal")
    hrclog.annotate(
        paths[1],
        exclude=[
            "..",
        ],
        reason="a visitor",
    )
    watch(tmp_path, viewer)
    assert [run.figures.name for run in viewer.runs] == [path.stem for path in paths[:2]]
    assert [figures.name for figures in viewer.campaigns] == ["campaign of 2 runs"]
    assert not [bar for lane in viewer.runs[1].figures.gantt.lanes if lane.kind == "done" for bar in lane.bars]


def test_a_run_is_drawn_while_it_is_recorded_and_counts_when_it_has_ended(viewer: Viewer, tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "run.mcap", run="a run", agents=["A", "B"])
    handle = recorder.start("A", "x")
    recorder.signal("gap", 0.5)

    def late() -> None:
        recorder.start("B", "y")
        recorder.signal("gap", 1.0)
        recorder.close()

    followed = watch(tmp_path, viewer, nothing, handle.end, nothing, late)
    (run,) = viewer.runs
    assert (run.recording_id, run.closed) == (recorder.run_id, True)
    assert run.names == ["a run (live)", "a run"]
    lanes = said(run.parts)
    assert list(lanes["A", "done", 0].values()) == ["x", ""]
    assert next(iter(lanes["B", "done", 0].values())) == "y still open"
    outcomes = [facts(part.figures)["outcome"] for part in run.parts]
    assert outcomes == ["running"] * (len(outcomes) - 2) + ["unfinished", "succeeded"]
    lines = [text for part in run.parts for text in part.figures.events.texts]
    assert lines == list(event_lines(read_log(tmp_path / "run.mcap").events.sort("seq"), 0).texts)
    samples_drawn = [len(one.values) for part in run.parts for one in part.figures.series if one.name == "gap"]
    assert samples_drawn == [1, 1]
    assert "signals" in {one.group for one in run.parts[-1].outline.series}
    assert followed == Followed({recorder.run_id}, {recorder.run_id})
    assert [figures.name for figures in viewer.campaigns] == ["campaign of 1 run"]


def test_a_run_that_begins_and_ends_between_two_looks_is_drawn_whole(viewer: Viewer, tmp_path: Path) -> None:
    def run() -> None:
        with Recorder(tmp_path / "run.mcap") as recorder, recorder.task("A", "x"):
            pass

    followed = watch(tmp_path, viewer, run)
    assert [run.whole is not None for run in viewer.runs] == [True]
    assert (len(followed.runs), len(followed.ended)) == (1, 1)


def killed(recorder: Recorder) -> None:
    """Leave a journal as a killed process would."""
    assert recorder._journal is not None
    recorder._journal.close()


def test_a_killed_recorder_leaves_its_run_unfinished_until_it_is_recovered(viewer: Viewer, tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "run.mcap", run="a run")
    recorder.start("A", "x")
    followed = Followed()
    before: list[Followed] = []

    def after_kill() -> None:
        before.append(Followed(set(followed.runs), set(followed.ended)))
        recover(journal_path(recorder.path))

    steps = [lambda: killed(recorder), nothing, after_kill]

    def wait(seconds: float) -> bool:
        if steps and seconds:
            steps.pop(0)()
        return False

    follow(tmp_path, "", wait, until_idle_s=2.0, tell=viewer.told.append, followed=followed)
    (run,) = viewer.runs
    assert run.names == ["a run (live)", "a run (unfinished)", "a run"]
    assert [text for text in viewer.told if "hrclog recover" in text and "its recorder has gone" in text] == viewer.told
    assert before == [Followed({recorder.run_id}, set())]
    assert followed == Followed({recorder.run_id}, {recorder.run_id})


def test_a_run_that_is_taken_up_again_is_drawn_from_its_first_beginning(viewer: Viewer, tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "run.mcap", run="a run")
    recorder.start("A", "x")
    later: list[Recorder] = []

    def again() -> None:
        killed(recorder)
        later.append(Recorder(tmp_path / "run.mcap", resume=True))
        later[0].start("A", "y")

    followed = watch(tmp_path, viewer, nothing, again, nothing, nothing, lambda: later.pop().close())
    assert [run.recording_id for run in viewer.runs] == [recorder.run_id, f"{recorder.run_id}-2"]
    tasks = {state.split()[0] for states in said(viewer.runs[1].parts).values() for state in states.values() if state}
    assert tasks == {"x", "y"}
    assert followed == Followed({recorder.run_id}, {recorder.run_id})
    assert viewer.campaigns[-1].name == "campaign of 1 run"


def test_logs_that_are_put_there_count_and_the_latest_of_them_are_drawn(viewer: Viewer, tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    followed = watch(tmp_path / "in", viewer, lambda: samples(tmp_path / "in", 5))
    assert len(viewer.runs) == 3
    assert viewer.told == ["2 further runs are in the statistics, not drawn: hrclog view FILE shows one"]
    assert (len(followed.runs), len(followed.ended)) == (5, 5)
    assert viewer.campaigns[-1].name == "campaign of 5 runs"


def test_a_log_that_is_still_being_copied_is_waited_for(viewer: Viewer, tmp_path: Path) -> None:
    data = (SAMPLES / "single.mcap").read_bytes()
    steps = [lambda size=size: (tmp_path / "copy.mcap").write_bytes(data[:size]) for size in (100, 2000, len(data))]
    watch(tmp_path, viewer, *steps)
    assert viewer.told == []
    assert [run.figures.name for run in viewer.runs] == ["paper_0000"]


def test_a_log_that_goes_leaves_the_statistics(viewer: Viewer, tmp_path: Path) -> None:
    paths = samples(tmp_path, 3)
    watch(tmp_path, viewer, nothing, paths[0].unlink)
    assert [figures.name for figures in viewer.campaigns] == ["campaign of 3 runs", "campaign of 2 runs"]


def test_what_cannot_be_read_is_told_once_and_the_rest_goes_on(viewer: Viewer, tmp_path: Path) -> None:
    samples(tmp_path, 1)
    (tmp_path / "bad.mcap").write_bytes(b"nonsense")
    (tmp_path / "x.mcap.partial").mkdir()
    damaged = bytearray((SAMPLES / "killed.mcap.partial").read_bytes())
    damaged[3000] ^= 1
    (tmp_path / "damaged.mcap.partial").write_bytes(damaged)
    watch(tmp_path, viewer, nothing, nothing)
    assert len(viewer.told) == 2
    assert "bad.mcap: found a file that begins with b'nonsense'" in viewer.told[0]
    assert "damaged.mcap.partial" in viewer.told[1]
    assert "corrupt_data" in viewer.told[1]
    assert [figures.name for figures in viewer.campaigns] == ["campaign of 1 run"]


def test_a_journal_that_is_replaced_is_another_run(viewer: Viewer, tmp_path: Path) -> None:
    recorders = [Recorder(tmp_path / f"{name}.mcap", run=name) for name in ("one", "two")]
    for recorder in recorders:
        recorder.start("A", f"task of {recorder.path.stem}")
    path = journal_path(recorders[0].path)
    watch(tmp_path, viewer, nothing, lambda: journal_path(recorders[1].path).replace(path), nothing)
    assert [run.figures.name for run in viewer.runs] == ["one", "two", "two"]
    assert [run.closed for run in viewer.runs] == [True] * 3
    assert set(said(viewer.runs[2].parts)["A", "done", 0].values()) == {"task of two"}
    for recorder in recorders:
        killed(recorder)


def test_journals_that_nobody_writes_are_told_of_and_drawn_when_they_grow(viewer: Viewer, tmp_path: Path) -> None:
    path, data = tmp_path / "old.mcap.partial", (SAMPLES / "killed.mcap.partial").read_bytes()
    path.write_bytes(data[: len(data) // 2])
    os.utime(path, (0, 0))

    def grow() -> None:
        assert viewer.runs == []
        path.write_bytes(data)

    followed = watch(tmp_path, viewer, nothing, grow)
    text = "1 unfinished log has no recorder any more, and no part in the statistics"
    assert viewer.told == [f"{text}: hrclog recover {tmp_path} closes them"]
    assert len(viewer.runs) == 1
    assert (len(followed.runs), len(followed.ended)) == (1, 0)


def test_a_journal_that_is_deleted_is_told_of(viewer: Viewer, tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "run.mcap")
    watch(tmp_path, viewer, nothing, journal_path(recorder.path).unlink)
    killed(recorder)
    assert viewer.told == [f"{tmp_path / 'run.mcap.partial'}: the journal is gone, and there is no log in its place"]
    assert viewer.runs[0].closed


def test_a_folder_that_is_deleted_meanwhile_is_one_clear_error(viewer: Viewer, tmp_path: Path) -> None:
    samples(tmp_path / "in", 1)
    with pytest.raises(LogReadError, match="in: found nothing, expected a folder into which runs are recorded"):
        watch(tmp_path / "in", viewer, lambda: shutil.rmtree(tmp_path / "in"))
    assert all(run.closed for run in viewer.runs)


def test_following_ends_when_it_is_enough(viewer: Viewer, tmp_path: Path) -> None:
    asked: list[float] = []

    def wait(seconds: float) -> bool:
        asked.append(seconds)
        return len(asked) == 3

    follow(tmp_path, "", wait, every_s=0.25, tell=viewer.told.append)
    assert len(asked) == 3
    assert all(0 < seconds <= 0.25 for seconds in asked)


def test_reading_what_is_there_can_be_enough(viewer: Viewer, tmp_path: Path) -> None:
    samples(tmp_path, 5)
    read: list[Path] = []
    assert follow(tmp_path, "", lambda _: len(read) == 2, on_file=read.append) == Followed()
    assert len(read) == 2
    assert viewer.runs == []


def test_statistics_that_fail_say_so_where_they_were_asked_for(tmp_path: Path) -> None:
    ended = EndedRuns()
    (path,) = samples(tmp_path, 1)
    ended.put(path, read_log(path))

    def fail(_: Analysis) -> None:
        raise LogReadError(path, "a", "b")

    statistics = Statistics(ended, fail)
    statistics.changed()
    with pytest.raises(LogReadError):
        statistics.finish()
    statistics.close()


def test_a_recorder_that_closes_its_log_is_not_taken_for_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Between letting go of the journal and putting the log in its place, nobody holds it."""
    path = tmp_path / "run.mcap.partial"
    path.touch()
    held = iter([True, False, True, False, False])
    monkeypatch.setattr(live_journal, "is_being_written", lambda _: next(held))
    journal = live_journal.LiveJournal(path, "", lambda _: None, lambda _: EVENTS.to_frame(), str)
    assert [journal._has_recorder() for _ in range(5)] == [True, True, True, True, False]


def test_failures_are_counted_as_they_come() -> None:
    live_executions = LiveExecutions()
    counts = []
    for task, outcome in (("x", "failed"), ("y", "succeeded"), ("z", "timed_out"), ("u", "canceled")):
        live_executions.take(frame([started("A", task, 1), ended("A", task, 2, outcome=outcome)]))
        counts.append(live_executions.n_failed)
    live_executions.take(
        frame([started("A", "step", 1, parent_execution_id="Au"), ended("A", "step", 2, outcome="failed")])
    )
    assert [*counts, live_executions.n_failed] == [1, 1, 2, 2, 2]


def test_planned_bars_stand_at_their_distance_from_the_start_of_the_run() -> None:
    planned = {"planned_start_ns": 102 * S, "planned_end_ns": 108 * S}
    run = LiveRun(frame([event("run_started", 100 * S), started("A", "x", 101, **planned)]))
    assert said([run.part(110 * S, alive=True)])["A", "planned", 0] == {2 * S: "x", 8 * S: ""}
