"""Results: names of recordings that every file system takes, one a run; and all files of one analysis, or marked."""

from __future__ import annotations

import random
import shutil
import unicodedata
from itertools import pairwise
from pathlib import Path

import polars as pl
import pytest
from dying import contents, die
from full_disks import largest_file
from hypothesis import given
from hypothesis import strategies as st
from sizes import many

from hrclog.analyzers.analysis import analyze
from hrclog.analyzers.output import drawn_runs, recording_names, save
from hrclog.analyzers.rerun.selection import recordings_at
from hrclog.analyzers.result import Analysis
from hrclog.errors import LogReadError, OutputError
from hrclog.file_sets import ANALYSIS_SET, manifest_name
from hrclog.files import write_output
from hrclog.log.files.search import search

SAMPLES = Path(__file__).parents[2] / "sample_logs"

NAME_MAX = 255
"""Bytes of a file's name that Linux, macOS and Windows take."""

IDS = st.sampled_from(["1", "2", "3", "4"]) | st.text(st.sampled_from("ab/"), min_size=40, max_size=42)
NAMES = (
    st.sampled_from(["a", "A", "a-1", "a/1", "", "..", "\uac00", "\u1100\u1161", "計" * 100, "計" * 101]) | st.text()
)


def names_of(*runs: tuple[str, str]) -> dict[str, str]:
    return recording_names(pl.DataFrame(runs, {"run_id": pl.String, "name": pl.String}, orient="row"))


def folded(name: str) -> str:
    return unicodedata.normalize("NFC", name.casefold())


def assert_apart(names: dict[str, str]) -> None:
    assert len({folded(name) for name in names.values()}) == len(names)


def test_a_run_alone_with_its_name_keeps_it() -> None:
    assert names_of(("1", "first run"), ("2", "../b")) == {"1": "first_run.rrd", "2": "_b.rrd"}


def test_a_long_name_is_cut_to_bytes_and_at_a_character() -> None:
    assert names_of(("1", "計" * 100)) == {"1": "計" * 33 + ".rrd"}


def test_a_name_that_another_would_get_for_its_id_is_not_given_twice() -> None:
    assert_apart(names_of(("1", "a"), ("2", "a"), ("3", "a-1")))
    taken = names_of(("1", "a"), ("2", "a"))["1"].removesuffix(".rrd")
    assert_apart(names_of(("1", "a"), ("2", "a"), ("3", taken.upper())))


def test_ids_that_begin_alike_are_told_apart() -> None:
    assert_apart(names_of(("x" * 40 + "1", "a"), ("x" * 40 + "2", "a")))


def test_names_that_differ_only_in_case_or_composition_are_told_apart() -> None:
    assert_apart(names_of(("1", "Run"), ("2", "run"), ("3", "\uac00"), ("4", "\u1100\u1161")))


@given(st.dictionaries(IDS, NAMES, max_size=6), st.randoms(use_true_random=False))
def test_names_are_different_short_and_the_same_in_every_order(runs: dict[str, str], chance: random.Random) -> None:
    names = names_of(*runs.items())
    assert names.keys() == runs.keys()
    assert_apart(names)
    for name in names.values():
        assert len(name.encode()) <= NAME_MAX
        assert "/" not in name
        assert not name.startswith(".")
    shuffled = list(runs.items())
    chance.shuffle(shuffled)
    assert names_of(*shuffled) == names


@given(st.integers(0, 40), st.integers(1, 12))
def test_the_runs_that_are_drawn_are_evenly_spread_and_hold_both_ends(count: int, most: int) -> None:
    ids = [f"r{index}" for index in range(count)]
    drawn = drawn_runs(pl.DataFrame({"run_id": ids}, {"run_id": pl.String}), most)
    assert len(drawn) == min(count, most)
    assert drawn == sorted(set(drawn), key=ids.index)
    if count > most > 1:
        assert (drawn[0], drawn[-1]) == (ids[0], ids[-1])
        steps = [ids.index(after) - ids.index(before) for before, after in pairwise(drawn)]
        assert max(steps) - min(steps) <= 1
    assert drawn_runs(pl.DataFrame({"run_id": ids}, {"run_id": pl.String}), None) == ids


# Results are whole or absent


@pytest.fixture(scope="module")
def analyses() -> tuple[Analysis, Analysis]:
    """Return what the old and the new results are of; runs of different names."""
    return analyze(SAMPLES / "single.mcap"), analyze(SAMPLES / "failures.mcap")


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Write recordings without what takes time: their pictures."""

    def recording(self: Analysis, path: Path) -> None:
        write_output(path, self.to_json().encode()[-2000:])

    monkeypatch.setattr(Analysis, "to_rerun", recording)
    monkeypatch.setattr(Analysis, "run_to_rerun", lambda self, _, path: recording(self, path))


def leftovers(folder: Path) -> list[Path]:
    return [*folder.rglob(".hrclog-*"), *folder.rglob("*.unfinished")]


@pytest.mark.usefixtures("undrawn")
def test_results_are_old_or_new_or_marked_whenever_analyze_dies(
    analyses: tuple[Analysis, Analysis], tmp_path: Path
) -> None:
    old, new = analyses
    save(old, tmp_path / "old")
    save(new, tmp_path / "new")
    before, wanted = contents(tmp_path / "old"), contents(tmp_path / "new")
    assert before.keys() != wanted.keys()
    n_changes = die(lambda: save(new, tmp_path / "old"), None)
    states = set()
    for after in range(0, n_changes, many(4, fuzz=1)):
        folder = tmp_path / str(after)
        shutil.copytree(tmp_path / "new", folder)
        (folder / "mine.txt").write_text("mine")
        save(old, folder)
        die(lambda to=folder: save(new, to), after)  # type: ignore[misc] - bound at once
        there = contents(folder)
        assert there.pop("mine.txt") == b"mine"
        if there.pop("analysis.unfinished", b""):  # an empty one says that nothing was moved yet
            states.add("marked")
            with pytest.raises(LogReadError, match=r"broken off.*run hrclog analyze LOG\.\.\. -o .* again"):
                recordings_at(folder)
            assert search(tmp_path).logs == {}
        else:
            states.add("old" if there == before else "new")
            assert there in (before, wanted)
        save(new, folder)
        assert contents(folder) == {"mine.txt": b"mine"} | wanted
        assert leftovers(folder) == []
        shutil.rmtree(folder)
    assert states == {"old", "marked", "new"}


@pytest.mark.usefixtures("undrawn")
def test_a_full_disk_leaves_the_old_results(analyses: tuple[Analysis, Analysis], tmp_path: Path) -> None:
    old, new = analyses
    save(old, tmp_path)
    before = contents(tmp_path)
    save(new, tmp_path)
    sizes = sorted({len(content) for content in contents(tmp_path).values()})
    save(old, tmp_path)
    for size in (0, 3, *(size - 1 for size in sizes[:: many(2, fuzz=1)]), sizes[-1] - 1):
        with largest_file(size), pytest.raises(OutputError, match=r"cannot be written \(File too large\); free space"):
            save(new, tmp_path)
        assert contents(tmp_path) == before
        assert leftovers(tmp_path) == []


@pytest.mark.usefixtures("undrawn")
def test_results_without_a_manifest_lose_the_recordings_that_their_json_names(
    analyses: tuple[Analysis, Analysis], tmp_path: Path
) -> None:
    old, new = analyses
    save(new, tmp_path / "new")
    save(old, tmp_path / "old")
    (tmp_path / "old" / manifest_name(ANALYSIS_SET)).unlink()
    (tmp_path / "old" / "runs" / "mine.rrd").write_bytes(b"mine")
    save(new, tmp_path / "old")
    assert contents(tmp_path / "old") == contents(tmp_path / "new") | {"runs/mine.rrd": b"mine"}


def test_an_unfinished_set_is_passed_over_as_results(tmp_path: Path) -> None:
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "run.mcap").write_bytes(b"")
    assert len(search(tmp_path).logs) == 1
    (tmp_path / "results" / "analysis.unfinished").write_text("somebody's note")
    assert len(search(tmp_path).logs) == 1
    (tmp_path / "results" / "analysis.unfinished").write_text('{"hrclog_version": "1"}')
    assert search(tmp_path).results == [tmp_path / "results"]
