"""What annotations exclude counts as if it had never been recorded, in whatever order it was said."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Final

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sizes import many

import hrclog
from hrclog.errors import HrclogError, InvalidEventError
from hrclog.events import Event, TaskFact
from hrclog.log.reader import read_logs
from hrclog.log.writing.writer import write_log
from hrclog.sim.run import simulate_run

N_RUNS: Final = 3
RUNS: Final = [simulate_run(hrclog.load_scenario("failures"), 5, index).events for index in range(N_RUNS)]
IDS: Final = [sorted({event.execution_id for event in events if isinstance(event, TaskFact)}) for events in RUNS]
ESTIMATES = ("durations", "synergies", "pair_overlaps", "intervals", "overlaps")


def written(folder: Path, runs: Iterable[Iterable[Event]] = RUNS) -> Path:
    folder.mkdir()
    for number, events in enumerate(runs):
        write_log(folder / f"{number}.mcap", events)
    return folder


def same_estimates(a: Path, b: Path) -> None:
    one, other = hrclog.analyze(a), hrclog.analyze(b)
    for name in ESTIMATES:
        left, right = (getattr(side, name) for side in (one, other))
        if "path" in left.columns:
            left, right = left.drop("path"), right.drop("path")
        assert left.equals(right), name


EXCLUDED = st.sets(
    st.tuples(st.integers(0, N_RUNS - 1), st.integers(0, min(map(len, IDS)) - 1)), min_size=1, max_size=8
)


@settings(max_examples=many(4, fuzz=40))
@given(EXCLUDED, st.sets(st.integers(0, N_RUNS - 1), max_size=N_RUNS - 1))
def test_logs_with_exclusions_give_what_logs_without_these_events_give(
    tmp_path_factory: pytest.TempPathFactory, executions: set[tuple[int, int]], runs: set[int]
) -> None:
    folder = tmp_path_factory.mktemp("excluded")
    logs = written(folder / "whole")
    ids = {IDS[run][place] for run, place in executions}
    for run, place in sorted(executions):
        hrclog.annotate(logs / f"{run}.mcap", exclude=[IDS[run][place]], reason="a mistake")
    for run in sorted(runs):
        hrclog.annotate(logs / f"{run}.mcap", exclude=["run"], reason="a pilot")
    # a step goes with its sequence
    kept = [
        [
            event
            for event in events
            if not isinstance(event, TaskFact) or not {event.execution_id, event.parent_execution_id} & ids
        ]
        for number, events in enumerate(RUNS)
        if number not in runs
    ]
    same_estimates(logs, written(folder / "never", kept))
    said = [finding for finding in hrclog.read_logs([logs]).diagnostics if finding.code == "excluded"]
    assert len(said) == 1
    assert not [finding for finding in hrclog.read_logs([logs]).diagnostics if finding.severity == "error"]


WORDS = st.lists(
    st.tuples(st.sampled_from(("exclude", "not_learnt", "include")), st.sampled_from((*IDS[0][:3], "run", "0..20"))),
    min_size=1,
    max_size=6,
)


def say(log: Path, word: str, target: str) -> None:
    expected = (
        contextlib.suppress(HrclogError) if word == "include" else contextlib.nullcontext()
    )  # nothing to take back
    with expected:
        hrclog.annotate(log, **{word: [target]}, reason="because")  # type: ignore[arg-type]  # by name


@settings(max_examples=many(6, fuzz=60))
@given(WORDS)
def test_the_last_word_on_a_target_holds(
    tmp_path_factory: pytest.TempPathFactory, words: list[tuple[str, str]]
) -> None:
    folder = tmp_path_factory.mktemp("words")
    said, short = written(folder / "said", RUNS[:1]), written(folder / "short", RUNS[:1])
    for word, target in words:
        say(said / "0.mcap", word, target)
        say(said / "0.mcap", word, target)  # twice is once
    last = {target: word for word, target in words}
    for target, word in sorted(last.items()):  # in another order
        if word != "include":
            say(short / "0.mcap", word, target)
    if "run" in last and last["run"] == "exclude":
        assert read_logs([said]).events.is_empty()
        assert read_logs([short]).events.is_empty()
        return
    same_estimates(said, short)


def test_what_is_not_learnt_from_still_disturbs_others_and_is_in_timelines(tmp_path: Path) -> None:
    logs, plain = written(tmp_path / "logs"), hrclog.analyze(written(tmp_path / "plain"))
    chosen = plain.intervals.filter(plain.intervals["agent"] == "robot").row(2, named=True)
    hrclog.annotate(logs, not_learnt=[chosen["execution_id"]], reason="the visitor was in the way")
    analysis = hrclog.analyze(logs)
    assert analysis.intervals.height == plain.intervals.height
    assert analysis.intervals.filter(analysis.intervals["role"] == "not_learnt")["execution_id"].to_list() == [
        chosen["execution_id"]
    ]
    assert analysis.metrics.equals(plain.metrics)
    counts = [side.durations["count"].sum() + side.durations["n_failed"].sum() for side in (plain, analysis)]
    assert counts[0] - counts[1] == 1
    assert chosen["execution_id"] not in analysis.observations.executions["execution_id"]
    met = analysis.observations.meetings.filter(
        analysis.observations.meetings["other_execution_id"] == chosen["execution_id"]
    )
    assert (
        met.height
        == plain.overlaps.filter(
            (plain.overlaps["other_execution_id"] == chosen["execution_id"]) & (plain.overlaps["agent"] != "robot")
        ).height
    )


def test_a_span_means_the_executions_that_have_a_part_in_it(tmp_path: Path) -> None:
    logs = written(tmp_path / "logs", RUNS[:1])
    plain = hrclog.analyze(logs)
    begin = RUNS[0][0].time_ns
    row = plain.intervals.row(5, named=True)
    start, end = ((row[name] - begin) / 1e9 for name in ("start_ns", "end_ns"))
    hrclog.annotate(logs, exclude=[f"{start + 0.001}..{end - 0.001}"], reason="noise")
    left = hrclog.analyze(logs).intervals
    touching = plain.intervals.filter(
        (plain.intervals["start_ns"] < row["end_ns"] - 10**6) & (plain.intervals["until_ns"] > row["start_ns"] + 10**6)
    )
    assert set(left["execution_id"]) == set(plain.intervals["execution_id"]) - set(touching["execution_id"])
    hrclog.annotate(logs, include=[f"{start + 0.001}..{end - 0.001}"])
    assert hrclog.analyze(logs).intervals.equals(plain.intervals)


@pytest.mark.slow
def test_two_processes_say_different_things(tmp_path: Path) -> None:
    logs = written(tmp_path / "logs", RUNS[:1])
    say_so = [sys.executable, "-m", "hrclog", "annotate", str(logs), "--reason", "a mistake", "--exclude"]
    saying = [subprocess.Popen([*say_so, execution]) for execution in IDS[0][:4]]
    assert [process.wait(120) for process in saying] == [0] * 4
    left = set(hrclog.analyze(logs, "ols").intervals["execution_id"])
    assert not left & set(IDS[0][:4])


BAD = [
    ({"exclude": ["nobody-knows-this"]}, HrclogError, "found none of this id"),
    ({"exclude": ["9..3"]}, InvalidEventError, "FROM before TO"),
    ({"exclude": ["a..3"]}, InvalidEventError, "seconds from the run's start"),
    ({"exclude": ["2026-03-02T09:00:00..2026-03-02T09:00:05Z"]}, InvalidEventError, "a zone"),
    ({"exclude": ["nan..3"]}, InvalidEventError, "seconds"),
    ({"exclude": ["run"], "include": ["run"]}, InvalidEventError, "twice"),
    ({"include": ["run"]}, HrclogError, "nothing is excluded"),
    ({"exclude": [""]}, InvalidEventError, "expected run"),
    ({"exclude": ["90000..90001"]}, HrclogError, "no execution that has a part in this span"),
    ({"not_learnt": ["..0"]}, HrclogError, "no execution that has a part in this span"),
    ({"exclude": ["0001-01-01T00:00:00Z.."]}, InvalidEventError, "between 1897 and 2043"),
    ({"exclude": ["0..1000000000"]}, InvalidEventError, "between 1897 and 2043"),
    ({"exclude": [5]}, InvalidEventError, "exclude is 5, expected a text"),
    ({"exclude": 5}, InvalidEventError, "exclude is 5, expected a text"),
    ({"author": 5, "exclude": ["run"]}, InvalidEventError, "author is 5, expected a text"),
    ({"tags": ["a=1"]}, InvalidEventError, "expected values by key"),
]


@pytest.mark.parametrize(("words", "kind", "text"), BAD)
def test_what_cannot_be_said_is_a_clear_error(
    words: dict[str, object], kind: type[HrclogError], text: str, tmp_path: Path
) -> None:
    logs = written(tmp_path / "logs", RUNS[:1])
    with pytest.raises(kind, match=text):
        hrclog.annotate(logs, **words, reason="because")  # type: ignore[arg-type]  # by name
    assert not list(logs.glob("*.annotations.mcap"))


def test_one_text_is_one_target(tmp_path: Path) -> None:
    events = [
        replace(event, execution_id=f"{IDS[0].index(event.execution_id)}") if isinstance(event, TaskFact) else event
        for event in RUNS[0]
    ]
    logs = written(tmp_path / "logs", [events])
    said = hrclog.annotate(logs, exclude="12", reason="a mistake", runs=next(iter(hrclog.analyze(logs).runs["name"])))
    assert [list(meant) for meant in said.executions.values()] == [["12"]]


def test_an_exclusion_is_taken_back_by_the_name_that_is_told_of_it(tmp_path: Path) -> None:
    logs = written(tmp_path / "logs", RUNS[:1])
    hrclog.annotate(logs, exclude=["0.000123456..50"], reason="noise")
    (told,) = (str(entry.target) for entry in hrclog.analyze(logs).exclusions)
    hrclog.annotate(logs, include=told)
    assert not hrclog.analyze(logs).exclusions


def test_a_reason_is_asked_for(tmp_path: Path) -> None:
    with pytest.raises(InvalidEventError, match="no reason"):
        hrclog.annotate(written(tmp_path / "logs", RUNS[:1]), exclude=["run"])


def test_an_annotation_of_what_is_not_there_is_told(tmp_path: Path) -> None:
    logs = written(tmp_path / "logs", RUNS[:1])
    hrclog.annotate(logs, exclude=[IDS[0][0]], reason="a mistake")
    (logs / "0.mcap").unlink()
    write_log(logs / "0.mcap", [replace(event) for event in RUNS[0] if getattr(event, "execution_id", "") != IDS[0][0]])
    codes = [finding.code for finding in read_logs([logs]).diagnostics]
    assert "exclusion_unmatched" in codes


def test_a_knowledge_base_learns_what_logs_without_the_excluded_teach(tmp_path: Path) -> None:
    from hrclog.analyzers.learning.ingest import ingest_logs, update_statistics

    logs = written(tmp_path / "logs")

    def times() -> str:
        with hrclog.open_knowledge(str(tmp_path / "kb.sqlite"), create=True) as kb:
            ingested = ingest_logs(kb, [logs])
            update_statistics(kb)
            assert len(kb.runs()) == N_RUNS
            return f"{len(ingested.added)} {len(ingested.replaced)} {kb.times().to_json()}"

    before = times()
    hrclog.annotate(logs / "0.mcap", {"tag": "x"}, reason="a note")
    assert times() == before.replace("3 0 ", "0 0 ", 1)
    hrclog.annotate(logs / "0.mcap", exclude=["run"], reason="a pilot")
    assert times().startswith("0 1 ")
    with (
        hrclog.open_knowledge(str(tmp_path / "kb.sqlite")) as kb,
        hrclog.open_knowledge(str(tmp_path / "other.sqlite"), create=True) as other,
    ):
        ingest_logs(other, [logs / "1.mcap", logs / "2.mcap"])
        update_statistics(other)
        assert kb.times().to_json() == other.times().to_json()
    hrclog.annotate(logs / "0.mcap", include=["run"])
    assert times() == before.replace("3 0 ", "0 1 ", 1)
