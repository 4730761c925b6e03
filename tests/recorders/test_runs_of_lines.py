"""Several runs in one stream of JSON lines: one after the other, or side by side where lines name their run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.log.reader import read_logs
from hrclog.log.writing.journal import journal_path
from hrclog.recorders.line_run import Recorded
from hrclog.recorders.stdin import MAX_OPEN, Hooks, record_stream

NOON = 1_772_452_800_000_000_000


def at(seconds: int) -> int:
    return NOON + seconds * 10**9


def started(seconds: int = 0, **fields: object) -> dict[str, Any]:
    return {"kind": "run_started", "time_ns": at(seconds), **fields}


def task(kind: str, seconds: int, name: str = "pick", **fields: object) -> dict[str, Any]:
    return {"kind": f"task_{kind}", "agent": "robot", "task": name, "time_ns": at(seconds), **fields}


def record(lines: list[dict[str, Any]], path: Path, **options: Any) -> tuple[list[Recorded], list[int]]:  # noqa: ANN401 - those of record_stream
    recording = record_stream(map(json.dumps, lines), path, **options)
    return recording.runs, [entry.line for entry in recording.refused]


def told(path: Path) -> list[tuple[str, str, str, int]]:
    columns = ("kind", "task", "outcome", "time_ns")
    return read_logs([path]).events.sort("seq").select(columns).rows()


def name_of(path: Path) -> str:
    return str(json.loads(read_logs([path]).events.sort("seq")["details"][0])["name"])


@settings(max_examples=15)
@given(data=st.data())
def test_runs_that_lines_name_are_recorded_side_by_side_as_each_would_be_alone(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("runs")
    field = data.draw(st.sampled_from(["run", "run_id"]))
    has_start = data.draw(st.booleans())
    alone: dict[str, list[dict[str, Any]]] = {}
    for number in range(data.draw(st.integers(1, 3))):
        times = range(number, number + 40, 10)
        lines = [task(("started", "ended")[index % 2], seconds) for index, seconds in enumerate(times)]
        lines += [{"kind": "run_ended", "time_ns": at(50)}] if data.draw(st.booleans()) else []
        alone[f"run {number}"] = ([started(number)] if has_start else []) + lines
    left = {name: list(lines) for name, lines in alone.items()}
    mixed: list[dict[str, Any]] = []
    while left:
        name = data.draw(st.sampled_from(sorted(left)))
        mixed.append(left[name].pop(0) | {field: name})
        if not left[name]:
            del left[name]
    runs, refused = record(mixed, folder / "cell.mcap")
    assert refused == []
    assert len(runs) == len(alone)
    assert [run.path.name for run in runs] == ["cell.mcap", "cell-run2.mcap", "cell-run3.mcap"][: len(runs)]
    for run in runs:
        name = name_of(run.path)
        [expected], _ = record(alone[name], folder / f"{name}.mcap")
        assert told(run.path) == told(expected.path)
        assert run.n_events == expected.n_events


def test_a_log_is_there_as_soon_as_its_run_ended_while_others_go_on(tmp_path: Path) -> None:
    path = tmp_path / "cell.mcap"
    seen: list[tuple[bool, bool]] = []
    lines = [
        started(run_id="a"),
        started(run_id="b"),
        task("started", 1, run_id="a"),
        task("started", 2, run_id="b"),
        {"kind": "run_ended", "run_id": "a", "time_ns": at(3)},
        task("ended", 4, run_id="b"),
    ]
    hooks = Hooks(on_event=lambda _: seen.append((path.exists(), journal_path(path).exists())))
    _, refused = record(lines, path, hooks=hooks)
    assert refused == []
    assert seen == [(False, True)] * 3 + [(True, False)]


@pytest.mark.parametrize("names", [{}, {"name": "a"}, {"run": "a"}, {"run_id": "a"}])
def test_the_next_run_ends_one_whose_lines_name_none(names: dict[str, str], tmp_path: Path) -> None:
    path = tmp_path / "cell.mcap"
    finished: list[str] = []
    hooks = Hooks(on_run=lambda run: finished.append(run.path.name), on_event=lambda _: finished.append("event"))
    lines = [started(**names), task("started", 1), started(5, name="b"), task("started", 6)]
    runs, refused = record(lines, path, hooks=hooks)
    assert refused == []
    assert finished == ["event", "cell.mcap", "event", "cell-run2.mcap"]
    assert told(runs[0].path)[-1] == ("run_ended", "", "succeeded", at(1))


def test_a_run_ends_at_its_last_line_where_others_go_on(tmp_path: Path) -> None:
    lines = [task("started", 1, run="a"), task("ended", 2, run="a"), task("started", 9, run="b")]
    runs, _ = record(lines, tmp_path / "cell.mcap")
    assert [told(run.path)[-1][3] for run in runs] == [at(2), at(9)]


def test_lines_of_a_run_that_ended_are_refused_and_its_name_may_begin_another(tmp_path: Path) -> None:
    end = {"kind": "run_ended", "run": "a", "time_ns": at(3)}
    lines = [
        task("started", 1, run="a"),
        end,
        task("started", 4, run="a"),
        started(5, run="a"),
        task("started", 6, run="a"),
    ]
    runs, refused = record(lines, tmp_path / "cell.mcap")
    assert refused == [3]
    assert [name_of(run.path) for run in runs] == ["a", "a"]


def test_a_name_that_comes_late_is_that_of_the_run_before_its_first_task(tmp_path: Path) -> None:
    signal = {"kind": "signal", "name": "force", "value": 1, "time_ns": at(0)}
    lines = [started(name="a"), signal, task("started", 1, run_id="7"), signal, task("ended", 2, run_id="7")]
    lines += [task("started", 9, run_id="8"), task("started", 10, run_id="7")]
    runs, refused = record(lines, tmp_path / "cell.mcap")
    assert refused == []
    assert [(name_of(run.path), run.n_events, run.n_samples) for run in runs] == [("a", 3, 2), ("8", 1, 0)]


def test_an_end_that_names_its_run_and_a_start_that_does_not_belong_together(tmp_path: Path) -> None:
    [run], refused = record([started(), task("started", 1), task("ended", 2, run="a")], tmp_path / "cell.mcap")
    assert (refused, run.n_events) == ([], 2)


def test_the_same_start_of_a_run_begins_another_once_there_were_tasks(tmp_path: Path) -> None:
    again = started(run="trial")
    lines = [again, again, task("started", 1, run="trial"), again, task("started", 2, run="trial")]
    runs, refused = record(lines, tmp_path / "cell.mcap")
    assert refused == [2]
    assert [run.n_events for run in runs] == [1, 1]


def test_only_so_many_runs_are_open_at_once(tmp_path: Path) -> None:
    lines = [task("started", number, run=f"run {number}") for number in range(MAX_OPEN + 1)]
    lines += [task("ended", 90, run="run 0"), task("ended", 90, run="run 1")]
    runs, refused = record(lines, tmp_path / "cell.mcap")
    assert refused == [MAX_OPEN + 2]
    assert [run.n_events for run in runs] == [1, 2] + [1] * (MAX_OPEN - 1)


def test_a_simulation_that_says_no_start_may_pass_any_instant(tmp_path: Path) -> None:
    times = [0, 5 * 10**8, 12 * 10**8, 4 * 10**9]
    lines = [{"kind": "run_started"}, *({"kind": "heartbeat", "time_ns": time} for time in times)]
    assert record(lines, tmp_path / "cell.mcap")[1] == []


@pytest.mark.parametrize("bad", [5, ["a"], {}, "\ud800", True])
@pytest.mark.parametrize("field", ["run", "run_id"])
def test_what_names_no_run_is_refused(field: str, bad: object, tmp_path: Path) -> None:
    lines = [started(), {"kind": "heartbeat", field: bad}, {"kind": "heartbeat", field: None}]
    runs, refused = record(lines, tmp_path / "cell.mcap")
    assert (refused, runs[0].n_events) == ([2], 1)


def test_the_first_run_that_is_named_is_the_one_that_is_resumed(tmp_path: Path) -> None:
    path = tmp_path / "cell.mcap"
    record([task("started", 1, run="a")], path)
    runs, refused = record([task("ended", 2, run="a"), task("started", 3, run="b")], path, resume=True)
    assert refused == []
    assert [(run.path.name, name_of(run.path)) for run in runs] == [("cell.2.mcap", "a"), ("cell-run2.mcap", "b")]


def test_the_clock_of_a_run_that_is_resumed_is_known(tmp_path: Path) -> None:
    path = tmp_path / "cell.mcap"
    simulated = [{"kind": "heartbeat", "time_ns": time} for time in (0, 11 * 10**8)]
    record(simulated, path)
    runs, refused = record([{"kind": "heartbeat"}, {"kind": "heartbeat", "time_ns": 12 * 10**8}], path, resume=True)
    assert (refused, runs[0].n_events) == ([], 2)
