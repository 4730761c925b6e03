"""Whatever the order, however often and by how many processes: the same runs give the same tables."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kb_reads import durations, results, synergies
from kb_runs import TASKS, frame_of_runs, run_of, state, state_at
from kb_work import ingest_runs

from hrclog.analyzers.learning.ingest import (
    frame_of_events,
    ingest,
    ingest_events,
    ingest_logs,
    rebuild,
    update_statistics,
)
from hrclog.analyzers.learning.learn import learn
from hrclog.analyzers.projections.intervals import SORT, intervals
from hrclog.analyzers.projections.schemas import DURATIONS, INTERVALS, SYNERGIES
from hrclog.analyzers.synergy.estimators import ESTIMATORS
from hrclog.knowledge import open_knowledge
from hrclog.knowledge.base import KnowledgeBase
from hrclog.knowledge.records import in_order, versions
from hrclog.knowledge.rows import frame_schema
from hrclog.knowledge.tables import RESULT_ORDER, TASK_DURATIONS, TASK_RESULTS, TASK_SYNERGIES
from hrclog.log.reader import read_events
from hrclog.log.writing.writer import write_log

SAMPLES = Path(__file__).parents[3] / "sample_logs"


@pytest.fixture
def kb(where: str) -> Iterator[KnowledgeBase]:
    with open_knowledge(where, create=True) as opened:
        yield opened


def test_tables_have_the_columns_of_an_analysis() -> None:
    assert list(frame_schema(TASK_RESULTS).items()) == [(k, v) for k, v in INTERVALS.items() if k != "path"]
    assert list(frame_schema(TASK_DURATIONS).items()) == list(DURATIONS.items())
    assert list(frame_schema(TASK_SYNERGIES).items()) == list(SYNERGIES.items())
    assert RESULT_ORDER == SORT


@pytest.mark.slow
def test_what_comes_out_is_what_an_analysis_of_the_logs_says(kb: KnowledgeBase) -> None:
    found = ingest_logs(kb, [SAMPLES / "campaign", SAMPLES / "failures.mcap"])
    assert len(found.added) == 13
    assert update_statistics(kb)
    executions = intervals(read_events([SAMPLES / "campaign", SAMPLES / "failures.mcap"]))
    executions = executions.with_columns(pl.lit("").alias("path"))
    learnt = learn(executions)
    assert results(kb).equals(executions)
    assert results(kb).schema == INTERVALS
    assert durations(kb).equals(learnt.durations)
    assert synergies(kb).equals(learnt.synergies)
    assert kb.times().to_json() == learnt.times.to_json()


@pytest.mark.slow
def test_the_same_runs_again_add_nothing(kb: KnowledgeBase) -> None:
    ingest_logs(kb, [SAMPLES / "campaign"])
    update_statistics(kb)
    before = state(kb)
    found = ingest_logs(kb, [SAMPLES / "campaign"])
    assert (found.added, found.replaced, len(found.unchanged)) == ([], [], 12)
    assert not update_statistics(kb)
    assert state(kb) == before


def test_the_same_events_in_another_file_are_the_same_run(kb: KnowledgeBase, tmp_path: Path) -> None:
    events = run_of(1)
    for name in ("a", "b"):
        write_log(tmp_path / f"{name}.mcap", events)
        found = ingest_logs(kb, [tmp_path / f"{name}.mcap"])
    assert found.unchanged == ["run-0001"]
    assert ingest_events(kb, events).unchanged == ["run-0001"]
    assert ingest_logs(kb, [tmp_path]).unchanged == ["run-0001"]


def test_a_digest_is_of_what_events_say_and_of_nothing_else() -> None:
    events = in_order(frame_of_runs([1]))
    [version] = versions(events).values()
    elsewhere = events.sample(fraction=1.0, shuffle=True, seed=1)
    elsewhere = elsewhere.with_columns(pl.lit("elsewhere").alias("path"), pl.lit(7, pl.Int64).alias("log_time_ns"))
    assert versions(in_order(elsewhere)) == {"run-0001": version}
    for column, value in (("reason", "x"), ("path_length", 1.0), ("time_ns", 5), ("details", '{"a": 1}')):
        changed = events.with_columns(
            pl.when(pl.col("seq") == 2).then(pl.lit(value)).otherwise(column).alias(column).cast(events.schema[column])
        )
        assert versions(in_order(changed))["run-0001"].digest != version.digest


def test_a_run_that_went_on_replaces_what_was_there_of_it(kb: KnowledgeBase) -> None:
    events = run_of(1)
    assert ingest_events(kb, events[:4]).added == ["run-0001"]
    update_statistics(kb)
    assert sorted(results(kb)["outcome"]) == ["succeeded", "unknown"]
    assert ingest_events(kb, events).replaced == ["run-0001"]
    assert ingest_events(kb, events[:6]).unchanged == ["run-0001"]
    assert results(kb).height == len(TASKS)
    assert update_statistics(kb)
    [run] = kb.runs()
    assert (run.n_events, run.outcome, run.name) == (10, "succeeded", "n1")


def test_what_a_superseded_version_declared_is_forgotten(kb: KnowledgeBase) -> None:
    events = frame_of_runs([1])
    other = events.head(4).with_columns(pl.col("details").str.replace('"pick"', '"sweep"', literal=True))
    ingest(kb, other)
    assert "sweep" in {task.task for task in kb.properties()}
    ingest(kb, events)
    assert {row[1] for row in state(kb)["task_properties"]} == {"'pick'", "'put'", "'wave'"}


def test_segments_of_one_run_given_together_are_one_run(kb: KnowledgeBase, tmp_path: Path) -> None:
    events = run_of(1)
    write_log(tmp_path / "a.mcap", events[:5])
    write_log(tmp_path / "a.2.mcap", events[5:])
    ingest_logs(kb, [tmp_path])
    [run] = kb.runs()
    assert (run.n_events, run.n_executions) == (10, 4)


def _parts(events: pl.DataFrame, chance: random.Random) -> list[pl.DataFrame]:
    runs = events["run_id"].unique(maintain_order=True).to_list()
    chance.shuffle(runs)
    cut = chance.randrange(len(runs) + 1)
    return [events.filter(pl.col("run_id").is_in(part)) for part in (runs[:cut], runs[cut:])]


@pytest.mark.slow
@settings(max_examples=6)
@given(st.randoms(use_true_random=False))
def test_order_shards_and_repetitions_do_not_matter(
    tmp_path_factory: pytest.TempPathFactory, chance: random.Random
) -> None:
    folder = tmp_path_factory.mktemp("kb")
    versions_of_runs = [frame_of_events(run_of(number)[:length]) for number in range(3) for length in (3, 6, 8, 10)]
    versions_of_runs += [last.with_columns(pl.lit("told anew").alias("reason")) for last in versions_of_runs[3::4]]
    with open_knowledge(folder / "a.sqlite", create=True) as once:
        for part in versions_of_runs:
            ingest(once, part)
        update_statistics(once, "paper")
        expected = state(once)
    again = versions_of_runs + chance.sample(versions_of_runs, 3)
    chance.shuffle(again)
    with open_knowledge(folder / "b.sqlite", create=True) as often:
        for part in again:
            ingest(often, part)
            if chance.random() < 0.2:
                update_statistics(often, "paper")
        update_statistics(often, "paper")
        assert state(often) == expected


@pytest.mark.slow
def test_a_thousand_runs_twice_are_a_thousand_runs(where: str) -> None:
    events = frame_of_runs(range(1000))
    with open_knowledge(where, create=True) as kb:
        assert len(ingest(kb, events).added) == 1000
        update_statistics(kb, "paper")
        before = state(kb)
        for part in _parts(events, random.Random(1)):
            found = ingest(kb, part)
            assert found.added == []
            assert found.replaced == []
        update_statistics(kb, "paper")
        assert state(kb) == before
        assert len(before["runs"]) == 1000
        assert len(before["task_results"]) == 4000


@pytest.mark.slow
def test_two_processes_at_once_lose_nothing_and_double_nothing(where: str, tmp_path: Path) -> None:
    numbers = [list(range(60)), list(reversed(range(30, 90)))]
    with get_context("spawn").Pool(2) as pool:
        added = pool.starmap(ingest_runs, [(where, part, 3) for part in numbers])
    assert sum(added) == 90
    with open_knowledge(where) as kb:
        update_statistics(kb)
        found = state(kb)
    ingest_runs(str(tmp_path / "alone.sqlite"), list(range(90)), 90)
    assert found == state_at(tmp_path / "alone.sqlite")


@pytest.mark.slow
def test_sqlite_and_postgresql_hold_the_same_bits(postgres: str, tmp_path: Path) -> None:
    odd = frame_of_runs([5]).with_columns(
        # ends of executions are every other event
        pl.Series("path_length", [None, None, -0.0, None, 5e-324, None, 0.1 + 0.2, None, 1.7e308, None]),
        pl.lit("a\0b 'ö' \\ \n\t\u2028 🦾").alias("reason"),
        pl.lit(-(2**61)).alias("planned_start_ns"),
    )
    states = []
    for place in (postgres, tmp_path / "kb.sqlite"):
        with open_knowledge(place, create=True) as kb:
            ingest(kb, pl.concat([frame_of_runs(range(4)), odd]))
            ingest_logs(kb, [SAMPLES / "campaign"])
            update_statistics(kb)
            kb.withdraw("n2", "a\0b")
            update_statistics(kb)
            states.append(state(kb))
            assert results(kb).filter(pl.col("run_id") == "run-0005")["reason"][0].startswith("a\u2400b")
    assert states[0] == states[1]
    assert {"5e-324", "0.30000000000000004", "1.7e+308"} <= {cell for row in states[0]["task_results"] for cell in row}


@pytest.mark.slow
def test_a_rebuild_from_logs_is_what_came_run_by_run(kb: KnowledgeBase, tmp_path: Path) -> None:
    for number in range(6):
        write_log(tmp_path / f"{number}.mcap", run_of(number))
        ingest_logs(kb, [tmp_path / f"{number}.mcap"])
        if number == 2:
            kb.withdraw("n1", "a reason")
        update_statistics(kb, "ols")
    before = state(kb)
    write_log(tmp_path / "other.mcap", run_of(99))
    ingest_logs(kb, [tmp_path / "other.mcap"])
    (tmp_path / "other.mcap").unlink()
    found = rebuild(kb, [tmp_path])
    assert len(found.added) == 6
    assert state(kb) == before


@pytest.mark.slow
def test_a_rebuild_that_fails_changes_nothing(kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch) -> None:
    ingest_logs(kb, [SAMPLES / "campaign"])
    update_statistics(kb)
    before = state(kb)

    def fail(*_: object) -> None:
        raise RuntimeError("killed")

    monkeypatch.setattr("hrclog.knowledge.update.put_statistics", fail)
    with pytest.raises(RuntimeError, match="killed"):
        rebuild(kb, [SAMPLES / "single.mcap"])
    assert state(kb) == before


def test_one_bad_log_among_many_does_not_hide_the_others(kb: KnowledgeBase, tmp_path: Path) -> None:
    write_log(tmp_path / "good.mcap", run_of(1))
    (tmp_path / "bad.mcap").write_text("nonsense")
    found = ingest_logs(kb, [tmp_path])
    assert found.added == ["run-0001"]
    assert [finding.code for finding in found.diagnostics] == ["unreadable_file"]


def test_two_runs_under_one_id_teach_nothing(kb: KnowledgeBase, tmp_path: Path) -> None:
    write_log(tmp_path / "a.mcap", run_of(1))
    write_log(tmp_path / "c.mcap", [replace(event, run_id="run-0001") for event in run_of(2)])
    found = ingest_logs(kb, [tmp_path])
    assert "conflicting_runs" in {finding.code for finding in found.diagnostics}
    assert kb.runs() == []


def test_runs_without_executions_are_kept_and_teach_nothing(kb: KnowledgeBase) -> None:
    ingest_events(kb, [run_of(1)[0]])
    assert update_statistics(kb)
    assert results(kb).is_empty()
    assert durations(kb).is_empty()
    assert kb.times().times == {}
    assert [run.outcome for run in kb.runs()] == [""]


@pytest.mark.slow
def test_other_estimators_are_kept_until_another_is_asked_for(kb: KnowledgeBase) -> None:
    ingest(kb, frame_of_runs(range(5)))
    assert update_statistics(kb, "ols", "isolation-forest")
    ingest(kb, frame_of_runs(range(6)))
    assert update_statistics(kb)
    made = kb.statistics()
    assert made is not None
    assert (made.estimator, made.outliers, len(made.runs)) == ("ols", "isolation-forest", 6)
    assert update_statistics(kb, "paper", "none")
    assert set(synergies(kb)["estimator"]) == {"paper"}


def test_a_new_version_of_the_estimators_makes_statistics_anew(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    ingest(kb, frame_of_runs(range(3)))
    assert update_statistics(kb, "paper")
    assert not update_statistics(kb, "paper")
    monkeypatch.setattr(type(ESTIMATORS["paper"]), "version", 99)
    assert update_statistics(kb, "paper")
