"""Gaps in the numbering of recipes."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest

from hrclog.recorders.importers.gaps import Gap, gap_report


def test_the_authors_online_runs_hide_27_of_227_attempts(data_dir: Path) -> None:
    documents = json.loads((data_dir / "safety_areas" / "task_results_online.json").read_text())
    report = gap_report({document["recipe"] for document in documents})
    assert report == [
        Gap("BASIC_SOLVER", 61, 11),
        Gap("COMPLETE_SOLVER", 50, 0),
        Gap("NOT_NEIGHBORING_TASKS", 64, 14),
        Gap("RELAXED_HA_SOLVER", 52, 2),
    ]
    assert (sum(gap.n_attempts for gap in report), sum(gap.n_missing for gap in report)) == (227, 27)


def test_attempts_are_counted_within_a_session() -> None:
    recipes = [f"P_rec_0_rep_0_{session}_{n}" for session, n in (("monday", 1), ("monday", 4), ("friday", 90))]
    assert gap_report(recipes) == [Gap("P", 5, 2)]


def test_recipes_of_other_stacks_are_counted_by_what_stands_before_the_number() -> None:
    assert gap_report(["run_1", "run_3", "try7", "try8", "try8"]) == [Gap("run", 3, 1), Gap("try", 2, 0)]


@pytest.mark.parametrize("name", ["", "plain", "at_20230711174237", "x" + "9" * 5000, "³", "1 "])
def test_names_without_a_counter_take_no_part(name: str) -> None:
    assert gap_report([name]) == []


def test_hostile_names_take_no_time() -> None:
    names = ["1" * 200_000 + "x", "_rec_1_rep_1" * 20_000 + "_7", "a_rec_" + "1" * 100_000 + "_5", "\n" * 100_000 + "3"]
    start = time.process_time()
    gap_report(names)
    assert time.process_time() - start < 2
