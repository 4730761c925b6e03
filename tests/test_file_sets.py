"""Sets of files: the old one, the new one, or one that is marked; what others put beside them stays."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from dying import contents, die
from folders import names_in
from full_disks import largest_file
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.errors import OutputError
from hrclog.file_sets import is_unfinished, manifest_name, marker_name, replaced_set, unfinished_names

pytestmark = pytest.mark.skipif(os.name != "posix", reason="links, locks and limits as POSIX has them")

KIND = "things"
FOREIGN = {"mine.txt": b"mine", "runs/mine.rrd": b"mine too"}
NAMES = ("a.json", "b.csv", "runs/c.rrd", "runs/d.rrd")

sets = st.dictionaries(st.sampled_from(NAMES), st.binary(max_size=40), min_size=1)


def fill(folder: Path, files: dict[str, bytes]) -> None:
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


def write(folder: Path, files: dict[str, bytes], *, keeps: bool = False) -> None:
    with replaced_set(folder, KIND, keeps=keeps) as new:
        fill(new, files)


def is_clean(folder: Path) -> bool:
    """Return whether nothing is left over."""
    return not list(folder.rglob(".hrclog-*")) and not (folder / marker_name(KIND)).exists()


@settings(max_examples=5)
@given(sets, sets, st.booleans())
def test_a_set_is_old_or_new_or_marked_whenever_its_process_dies(
    tmp_path_factory: pytest.TempPathFactory, old: dict[str, bytes], new: dict[str, bytes], keeps: bool
) -> None:
    top = tmp_path_factory.mktemp("sets")
    states = set()
    wanted = FOREIGN | (old if keeps else {}) | new
    for after in range(200):
        folder = top / str(after)
        fill(folder, FOREIGN)
        write(folder, old, keeps=keeps)
        done = die(lambda to=folder: write(to, new, keeps=keeps), after)  # type: ignore[misc] - bound at once
        there = contents(folder)
        marked = is_unfinished(folder, KIND)
        there.pop(marker_name(KIND), None)
        assert there.items() >= FOREIGN.items()
        assert marked or there in (FOREIGN | old, wanted)
        states.add("marked" if marked else "old" if there == FOREIGN | old else "new")
        if marked:
            assert unfinished_names(folder, KIND) >= new.keys()
        write(folder, new, keeps=keeps)
        assert contents(folder) == wanted
        assert is_clean(folder)
        if done < after:
            assert "marked" in states
            return
    pytest.fail("it never came to its end")


@given(sets, sets, st.integers(0, 400))
def test_a_full_disk_leaves_the_old_set(
    tmp_path_factory: pytest.TempPathFactory, old: dict[str, bytes], new: dict[str, bytes], size: int
) -> None:
    folder = tmp_path_factory.mktemp("sets") / "results"
    fill(folder, FOREIGN)
    write(folder, old)
    is_full = False
    try:
        with largest_file(size):
            write(folder, new)
    except OutputError as error:
        is_full = "File too large" in str(error)
    assert contents(folder) == FOREIGN | (old if is_full else new)
    assert is_clean(folder)


@given(sets, sets, st.integers(0, 9))
def test_an_error_while_files_are_moved_puts_them_back(
    tmp_path_factory: pytest.TempPathFactory, old: dict[str, bytes], new: dict[str, bytes], number: int
) -> None:
    folder = tmp_path_factory.mktemp("sets")
    fill(folder, FOREIGN)
    write(folder, old)
    left = [number]

    def put(source: Path, target: Path) -> None:
        if not left[0]:
            left[0] = 1000
            raise OSError(28, "No space left on device")
        left[0] -= 1
        source.replace(target)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("hrclog.file_sets.put", put)
        try:
            write(folder, new)
        except OutputError:
            assert contents(folder) == FOREIGN | old
        else:
            assert contents(folder) == FOREIGN | new
    assert is_clean(folder)


def test_two_deaths_are_repaired_by_the_next_set(tmp_path: Path) -> None:
    for after in range(10, 40):
        folder = tmp_path / str(after)
        fill(folder, FOREIGN)
        write(folder, {"a": b"1", "runs/b": b"1"})
        die(lambda to=folder: write(to, {"a": b"2", "runs/c": b"2"}), after)  # type: ignore[misc] - bound at once
        die(lambda to=folder: write(to, {"a": b"3", "runs/d": b"3"}), after)  # type: ignore[misc] - bound at once
        write(folder, {"a": b"4"})
        assert contents(folder) == FOREIGN | {"a": b"4"}
        assert is_clean(folder)


def test_a_file_that_somebody_changed_is_theirs(tmp_path: Path) -> None:
    write(tmp_path, {"a": b"1", "b": b"1"})
    (tmp_path / "b").write_bytes(b"changed by hand")
    write(tmp_path, {"a": b"2"})
    assert contents(tmp_path) == {"a": b"2", "b": b"changed by hand"}


def test_sets_of_other_kinds_stay(tmp_path: Path) -> None:
    write(tmp_path, {"a": b"1"})
    with replaced_set(tmp_path, "others") as new:
        fill(new, {"b": b"1"})
    write(tmp_path, {"c": b"1"})
    assert contents(tmp_path) == {"b": b"1", "c": b"1"}


@pytest.mark.parametrize("name", ["../victim", "runs/../../victim", "VICTIM", "..", "", "a\0b"])
@pytest.mark.parametrize("place", [manifest_name, marker_name])
def test_a_manifest_cannot_reach_out_of_its_folder(name: str, place: object, tmp_path: Path) -> None:
    assert callable(place)
    victim, folder = tmp_path / "victim", tmp_path / "results"
    victim.write_text("")
    folder.mkdir()
    named = str(victim) if name == "VICTIM" else name
    (folder / place(KIND)).write_text(json.dumps({"files": {named: ["cae66941d9efbd404e4d88758ea67670", ""]}}))
    write(folder, {"a": b"1"})
    assert victim.exists()
    assert contents(folder) == {"a": b"1"}


@pytest.mark.parametrize("text", ["", "{", "[]", "[" * 100_000, '{"files": 3}', '{"files": {"a": 3}}', "\ud800"])
def test_a_manifest_that_is_none_says_nothing(text: str, tmp_path: Path) -> None:
    write(tmp_path, {"a": b"1"})
    (tmp_path / manifest_name(KIND)).write_bytes(text.encode("utf-8", "surrogatepass"))
    write(tmp_path, {"b": b"1"})
    assert contents(tmp_path) == {"a": b"1", "b": b"1"}


def test_a_folder_in_the_place_of_a_file_is_told_before_anything_is_moved(tmp_path: Path) -> None:
    write(tmp_path, {"a": b"1", "b": b"1"})
    (tmp_path / "b").unlink()
    (tmp_path / "b").mkdir()
    with pytest.raises(OutputError, match=f"{tmp_path}/b: cannot be written"):
        write(tmp_path, {"a": b"2", "b": b"2"})
    assert contents(tmp_path) == {"a": b"1"}
    assert is_clean(tmp_path)


def test_links_stay_links(tmp_path: Path) -> None:
    real, folder = tmp_path / "real", tmp_path / "results"
    (real / "runs").mkdir(parents=True)
    folder.symlink_to(real)
    (tmp_path / "elsewhere").mkdir()
    (real / "runs").rmdir()
    (real / "runs").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "a").write_bytes(b"0")
    (real / "a").symlink_to(tmp_path / "a")
    for number in (b"1", b"2"):
        write(folder, {"a": number, "runs/b": number})
        assert folder.is_symlink()
        assert (real / "runs").is_symlink()
        assert (real / "a").is_symlink()
        assert ((tmp_path / "a").read_bytes(), (tmp_path / "elsewhere" / "b").read_bytes()) == (number, number)
    write(folder, {"c": b"3"})
    assert names_in(tmp_path / "elsewhere") == []


@pytest.mark.skipif(not os.access("/dev/shm", os.W_OK), reason="needs a second disk")  # noqa: S108 - it is one
def test_a_folder_on_another_disk_takes_its_part_of_the_set(tmp_path: Path) -> None:
    other = Path("/dev/shm", f"hrclog-test-{os.getpid()}")  # noqa: S108 - a disk of its own
    other.mkdir()
    try:
        (tmp_path / "runs").symlink_to(other)
        for number in (b"1", b"2"):
            write(tmp_path, {"a": number, "runs/b": number})
            assert (other / "b").read_bytes() == number
        write(tmp_path, {"a": b"3"})
        assert names_in(other) == []
        assert is_clean(tmp_path)
    finally:
        for path in other.iterdir():
            path.unlink()
        other.rmdir()


def test_an_error_leaves_no_folder_that_was_not_there(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), replaced_set(tmp_path / "new", KIND):
        raise ZeroDivisionError
    assert names_in(tmp_path) == []


def test_processes_that_write_one_set_at_once_leave_the_set_of_one(tmp_path: Path) -> None:
    code = (
        "import sys, pathlib; from hrclog.file_sets import replaced_set\n"
        "for turn in range(40):\n"
        "    with replaced_set(pathlib.Path(sys.argv[1]), 'things') as new:\n"
        "        for name in 'abcd' + sys.argv[2]: (new / name).write_text(f'{sys.argv[2]} {turn}')"
    )
    processes = [subprocess.Popen([sys.executable, "-c", code, str(tmp_path), name]) for name in "xyz"]
    assert [process.wait() for process in processes] == [0, 0, 0]
    there = contents(tmp_path)
    assert len(there) == 5
    assert len(set(there.values())) == 1
    assert is_clean(tmp_path)
