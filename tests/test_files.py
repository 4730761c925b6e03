"""Files that are whole or absent: at any death, on a full disk, through links, beside other processes."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import threading
from pathlib import Path
from typing import IO

import pytest
from dying import die
from folders import names_in
from full_disks import largest_file
from hypothesis import given
from hypothesis import strategies as st

from hrclog.errors import HrclogError, LogWriteError, OutputError
from hrclog.files import hidden_folder, placed, put, write_output, write_whole
from hrclog.log.files.system import replace_atomically

pytestmark = pytest.mark.skipif(os.name != "posix", reason="links, locks and limits as POSIX has them")

OLD, NEW = b"old" * 10, b"new" * 1000


def by_steps(stream: IO[bytes]) -> None:
    for start in range(0, len(NEW), 500):
        stream.write(NEW[start : start + 500])


def by_path(path: Path) -> None:
    with placed(path) as hidden:
        hidden.write_bytes(NEW)


@pytest.mark.parametrize(
    "work",
    [
        lambda path: write_whole(path, by_steps),
        lambda path: write_whole(path, NEW, durable=True),
        lambda path: replace_atomically(path, by_steps),
        by_path,
    ],
)
@pytest.mark.parametrize("before", [OLD, None])
def test_a_file_is_old_or_new_whenever_its_process_dies(
    work: object, before: bytes | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert callable(work)
    path = tmp_path / "file.txt"
    for after in range(50):
        monkeypatch.setattr("hrclog.files._swept", set())  # each death is of another process
        path.unlink(missing_ok=True)
        if before is not None:
            path.write_bytes(before)
        done = die(lambda: work(path), after)
        assert (path.read_bytes() if path.exists() else None) in (before, NEW)
        if done < after:
            break
    assert done > 3
    monkeypatch.setattr("hrclog.files._swept", set())
    work(path)
    assert path.read_bytes() == NEW
    assert names_in(tmp_path) == ["file.txt"]


@given(st.integers(0, 2999), st.sampled_from([OLD, None]))
def test_a_full_disk_is_one_error_that_names_the_file_and_leaves_the_old_one(
    tmp_path: Path, size: int, before: bytes | None
) -> None:
    path = tmp_path / "file.txt"
    path.unlink(missing_ok=True)
    if before is not None:
        path.write_bytes(before)
    with largest_file(size):
        with pytest.raises(OutputError, match=r"file\.txt: cannot be written \(File too large\); free space"):
            write_output(path, by_steps)
        with pytest.raises(LogWriteError, match=r"file\.txt: cannot be written \(File too large\); free space"):
            replace_atomically(path, by_steps)
        with pytest.raises(OSError, match="File too large") as caught:
            by_path(path)
    assert caught.value.filename == str(path)
    assert (path.read_bytes() if path.exists() else None) == before
    assert names_in(tmp_path) == ["file.txt"][: before is not None]


def test_a_link_stays_a_link_and_permissions_stay(tmp_path: Path) -> None:
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    file, link = folder / "file.txt", tmp_path / "link.txt"
    file.write_bytes(OLD)
    file.chmod(0o640)
    link.symlink_to(file)
    for write in (lambda: write_whole(link, NEW), lambda: by_path(link)):
        file.write_bytes(OLD)
        write()
        assert link.is_symlink()
        assert file.read_bytes() == NEW
        assert stat.S_IMODE(file.stat().st_mode) == 0o640
    assert names_in(folder) == ["file.txt"]


def test_a_link_to_a_file_that_is_not_there_makes_it(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "file")
    write_whole(tmp_path / "link", NEW)
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "file").read_bytes() == NEW


def test_a_pipe_is_written_to_and_stays_a_pipe(tmp_path: Path) -> None:
    pipe, read = tmp_path / "pipe", []
    os.mkfifo(pipe)
    for write in (lambda: write_whole(pipe, NEW), lambda: by_path(pipe)):
        reader = threading.Thread(target=lambda: read.append(pipe.read_bytes()))
        reader.start()
        write()
        reader.join()
    assert read == [NEW, NEW]
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_a_new_file_replaces_none(tmp_path: Path) -> None:
    write_whole(tmp_path / "a", OLD, is_new=True)
    with pytest.raises(FileExistsError) as caught:
        write_whole(tmp_path / "a", NEW, is_new=True)
    assert caught.value.filename == str(tmp_path / "a")
    assert (tmp_path / "a").read_bytes() == OLD
    assert names_in(tmp_path) == ["a"]


def test_what_is_written_beside_the_file_goes_with_it(tmp_path: Path) -> None:
    with placed(tmp_path / "sub" / "a.csv") as hidden:
        hidden.write_bytes(NEW)
        hidden.with_suffix(".txt").write_bytes(OLD)
    assert names_in(tmp_path / "sub") == ["a.csv", "a.txt"]


def test_no_error_names_a_hidden_place(tmp_path: Path) -> None:
    with pytest.raises(HrclogError, match=f"^{tmp_path}/a.csv: wrong$"), placed(tmp_path / "a.csv") as hidden:
        raise HrclogError(f"{hidden}: wrong")
    with pytest.raises(OutputError) as caught, placed(tmp_path / "a.csv") as hidden:
        raise OutputError(hidden, "wrong")
    assert caught.value.path == tmp_path / "a.csv"
    assert ".hrclog" not in str(caught.value)


def test_what_a_living_process_writes_is_not_swept(tmp_path: Path) -> None:
    code = (
        "import sys, pathlib; from hrclog.files import hidden_folder\n"
        "with hidden_folder(pathlib.Path(sys.argv[1])) as folder:\n"
        "    (folder / 'a').write_text('a'); print(folder, flush=True); sys.stdin.readline()"
    )
    streams = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], **streams) as process:  # type: ignore[call-overload]
        living = Path(process.stdout.readline().strip())
        with hidden_folder(tmp_path):
            assert (living / "a").exists()
        process.kill()
        process.wait()
    assert names_in(tmp_path) == [living.name]
    with hidden_folder(tmp_path):
        assert not living.exists()
    assert names_in(tmp_path) == []


def test_only_what_hrclog_left_is_swept(tmp_path: Path) -> None:
    others = [".hrclog", ".hrclog-notes.txt", ".hrclog.analysis", "hrclog-1-2.tmp"]
    for name in others:
        (tmp_path / name).write_text("")
    (tmp_path / ".hrclog-1-2.tmp").write_text("")  # whatever process has that number now
    (tmp_path / ".hrclog-1-3.tmp").symlink_to(tmp_path / ".hrclog")
    with hidden_folder(tmp_path):
        pass
    assert names_in(tmp_path) == sorted([*others, ".hrclog-1-3.tmp"])


@pytest.mark.skipif(not os.access("/dev/shm", os.W_OK), reason="needs a second disk")  # noqa: S108 - it is one
def test_a_file_moves_to_another_disk_in_one_step(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(NEW)
    target = Path("/dev/shm", f"hrclog-test-{os.getpid()}")  # noqa: S108 - a disk of its own
    try:
        put(tmp_path / "a", target)
        assert target.read_bytes() == NEW
    finally:
        target.unlink(missing_ok=True)
