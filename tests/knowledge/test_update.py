"""Statistics are swapped as a whole, of the runs that are there, while others read and write."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import polars as pl
import pytest
from kb_reads import durations, results
from kb_runs import frame_of_runs, state
from kb_work import watch

from hrclog.analyzers.learning.ingest import ingest, update_statistics
from hrclog.analyzers.learning.learn import learn
from hrclog.analyzers.synergy.estimators import ESTIMATORS
from hrclog.knowledge import open_knowledge
from hrclog.knowledge.base import KnowledgeBase
from hrclog.knowledge.update import Method, rebuild, update
from hrclog.knowledge.write import Taught


def taught(results: pl.DataFrame) -> Taught:
    learnt = learn(results, "paper")
    return Taught(learnt.durations, learnt.synergies, learnt.times)


@pytest.mark.slow
def test_a_reader_never_sees_an_empty_or_mixed_statistic(where: str, tmp_path: Path) -> None:
    ready, stop = tmp_path / "ready", tmp_path / "stop"
    with open_knowledge(where, create=True) as kb, ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        ingest(kb, frame_of_runs(range(2)))
        update_statistics(kb, "paper")
        watching = pool.submit(watch, where, str(ready), str(stop))
        while not ready.exists():
            assert not watching.done()
        for number in range(25):
            ingest(kb, frame_of_runs(range(number, number + 3)))
            update_statistics(kb, ("paper", "ols")[number % 2])
        stop.touch()
        found = watching.result()
    assert found["wrong"] == []
    assert found["seen"] > 1
    assert found["reads"] > 5  # a busy machine reads seldom


@pytest.mark.slow
@pytest.mark.parametrize("meanwhile", [1, 2, 3, 9])
def test_runs_that_come_while_statistics_are_made_are_in_them(where: str, meanwhile: int, tmp_path: Path) -> None:
    numbers = iter(range(2, 2 + meanwhile))
    with open_knowledge(where, create=True) as kb, open_knowledge(where, wait_s=0.05) as other:
        ingest(kb, frame_of_runs(range(2)))

        def teach(results: pl.DataFrame) -> Taught:
            number = next(numbers, None)
            if number is not None and number < 5:  # from the fourth time on, others have to wait
                ingest(other, frame_of_runs([number]))
            return taught(results)

        assert update(kb, Method("paper", ESTIMATORS["paper"].version, "none", teach))
        found = state(kb)
    with open_knowledge(tmp_path / "alone.sqlite", create=True) as alone:
        ingest(alone, frame_of_runs(range(min(2 + meanwhile, 5))))
        update_statistics(alone, "paper")
        assert state(alone) == found


def test_a_run_withdrawn_while_everything_is_rebuilt_stays_out(where: str) -> None:
    from hrclog.analyzers.learning.ingest import _records

    with open_knowledge(where, create=True) as kb, open_knowledge(where) as other:
        ingest(kb, frame_of_runs(range(3)))

        def teach(results: pl.DataFrame) -> Taught:
            if other.runs()[1].withdrawn is None:
                other.withdraw("n1")
            return taught(results)

        rebuild(kb, _records(frame_of_runs(range(4)))[0], Method("paper", ESTIMATORS["paper"].version, "none", teach))
        made = kb.statistics()
        assert made is not None
        assert [run for run, _ in made.runs] == ["run-0000", "run-0002", "run-0003"]
        assert set(durations(kb)["count"] + durations(kb)["n_failed"]) == {3}


def test_withdrawing_and_undoing_gives_the_same_state(where: str) -> None:
    with open_knowledge(where, create=True) as kb:
        ingest(kb, frame_of_runs(range(5)))
        update_statistics(kb, "ols")
        before = state(kb)
        assert kb.withdraw("n3", "why not") == "run-0003"
        assert update_statistics(kb)
        assert state(kb) != before
        assert {run.run_id: run.withdrawn for run in kb.runs()}["run-0003"] == "why not"
        assert "run-0003" not in results(kb)["run_id"].to_list()
        ingest(kb, frame_of_runs(range(5)))
        assert not update_statistics(kb)
        kb.undo_withdrawal("run-0003")
        assert update_statistics(kb)
        assert state(kb) == before


@pytest.mark.slow
def test_statistics_without_a_withdrawn_run_are_those_of_the_others(where: str, tmp_path: Path) -> None:
    derived = ("task_durations", "task_synergies", "task_times", "statistics", "statistics_runs")
    with open_knowledge(where, create=True) as kb, open_knowledge(tmp_path / "alone.sqlite", create=True) as alone:
        ingest(kb, frame_of_runs(range(5)))
        kb.withdraw("n0")
        ingest(alone, frame_of_runs(range(1, 5)))
        for each in (kb, alone):
            update_statistics(each)
        assert state(kb, derived) == state(alone, derived)


def test_properties_are_those_that_the_latest_run_declares(where: str) -> None:
    def declared(kb: KnowledgeBase) -> dict[str, dict[str, float]]:
        return {task.task: dict(task.expected_s) for task in kb.properties()}

    events = frame_of_runs(range(3))
    newer = events["details"].str.replace('"expected_s":4', '"expected_s":7', literal=True)
    changed = events.with_columns(
        pl.when(pl.col("run_id") == "run-0001").then(newer).otherwise("details").alias("details")
    )
    with open_knowledge(where, create=True) as kb:
        ingest(kb, changed)
        assert declared(kb) == {"pick": {"robot": 4.0}, "put": {"robot": 5.5}, "wave": {}}
        kb.withdraw("n2")
        assert declared(kb)["pick"] == {"robot": 7.0}
        assert len(state(kb)["task_properties"]) == 6
