"""Folders are searched to any depth: each log once, in one order, and nothing is hidden without a word."""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.log.files.discover import find_logs

FOLDERS = ("a", "B", "b c", ".hidden", "__MACOSX", "node_modules", "line\nbreak", "-o", "x.mcap")
PASSED_OVER = {".hidden", "__MACOSX", "node_modules"}
FILES = (
    "r.mcap",
    "r.mcap.partial",
    "s.db3",
    "t.bag",
    "u.mcap.zst",
    "V.MCAP",
    "w.Bag.GZ",
    "._r.mcap",
    "notes.txt",
    "truth.json",
    "q\n.mcap",
)
NO_LOGS = {"._r.mcap", "notes.txt", "truth.json"}

paths = st.tuples(st.lists(st.sampled_from(FOLDERS), max_size=4), st.sampled_from(FILES))


def put(path: Path, content: bytes = b"") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


def names(root: Path, *arguments: Path) -> list[str]:
    return [str(path.relative_to(root)) for path in find_logs(arguments or [root])]


@settings(max_examples=40)
@given(st.lists(paths, max_size=12))
def test_every_log_is_there_once_in_the_order_of_the_parts_of_its_path(files: list[tuple[list[str], str]]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder, "root")
        root.mkdir()
        for parts, name in files:
            put(root.joinpath(*parts, name))
        expected = {
            root.joinpath(*parts, name)
            for parts, name in files
            if PASSED_OVER.isdisjoint(parts) and name not in NO_LOGS
        }
        assert find_logs([root]) == sorted(expected, key=lambda path: path.parts)
        assert find_logs([root, str(root)]) == find_logs([root])


@settings(max_examples=40)
@given(
    st.lists(st.tuples(st.sampled_from("abcd"), st.sampled_from("abcd")), max_size=6),
    st.lists(st.tuples(st.sampled_from("abcd"), st.sampled_from("abcd")), max_size=4),
)
def test_links_add_no_log_and_change_no_name(
    folder_links: list[tuple[str, str]], others: list[tuple[str, str]]
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder, "root")
        logs = [put(root / name / "in" / "r.mcap") for name in "abcd"]
        for number, (place, target) in enumerate(folder_links):
            (root / place / f"0{number}").symlink_to(root / target, target_is_directory=True)
        for number, (place, target) in enumerate(others):
            (root / place / f"0{number}.mcap").symlink_to(root / target / "in" / "r.mcap")
            os.link(root / target / "in" / "r.mcap", root / target / "in" / f"z{number}.mcap")
        assert find_logs([root]) == logs


def test_links_are_followed_out_of_the_folder_and_not_up(tmp_path: Path) -> None:
    outside = tmp_path / "elsewhere"
    put(outside / "deep" / "far.mcap")
    put(tmp_path / "beside.mcap")
    root = tmp_path / "root"
    put(root / "here.mcap")
    for link, target in {
        "up": "..",
        "self": ".",
        "sub/top": "..",
        "out": "../elsewhere",
        "again": "../elsewhere/deep",
        "file.mcap": "../elsewhere/deep/far.mcap",
        "round": "round",
    }.items():
        (root / link).parent.mkdir(exist_ok=True)
        (root / link).symlink_to(target)
    (outside / "back").symlink_to(root)
    (outside / "all").symlink_to(tmp_path)
    above = tmp_path / "above"
    above.mkdir()
    (outside / "other").symlink_to(above)
    (above / "all").symlink_to(tmp_path)
    assert names(root) == ["again/far.mcap", "here.mcap"]
    assert names(tmp_path, root, outside) == [*(f"root/{name}" for name in names(root))]


def test_a_bag_is_one_log_wherever_it_lies(tmp_path: Path) -> None:
    for place in ("bag", "study/bag", "bag/inner"):
        put(tmp_path / place / "metadata.yaml")
        put(tmp_path / place / "bag_0.mcap")
    put(tmp_path / "study" / "metadata.yaml", b"title: a study of ours")
    put(tmp_path / "lost" / "metadata.yaml", b"rosbag2_bagfile_information:\n  version: 5\n")
    (tmp_path / "best.mcap").symlink_to("bag/bag_0.mcap")
    (tmp_path / "latest").symlink_to("bag")
    assert names(tmp_path) == ["bag", "bag/inner", "lost", "study/bag"]
    assert names(tmp_path, tmp_path / "bag") == ["bag", "bag/inner"]
    put(tmp_path / "odd" / "metadata.yaml")
    assert names(tmp_path, tmp_path / "odd") == ["odd"]  # so that reading it says what it lacks


def test_an_environment_is_not_searched_unless_it_is_named(tmp_path: Path) -> None:
    put(tmp_path / "venv" / "pyvenv.cfg")
    put(tmp_path / "venv" / "lib" / "single.mcap")
    assert names(tmp_path) == []
    assert names(tmp_path, tmp_path / "venv") == ["venv/lib/single.mcap"]
    put(tmp_path / ".hidden" / "r.mcap")
    assert names(tmp_path, tmp_path / ".hidden") == [".hidden/r.mcap"]


@pytest.mark.slow
def test_ten_thousand_files_in_a_thousand_folders_are_found_in_well_under_a_second(tmp_path: Path) -> None:
    for number in range(1000):
        folder = tmp_path / str(number % 10) / str(number)
        folder.mkdir(parents=True)
        for name in range(10):
            (folder / f"{name}.mcap").touch()
    since = time.process_time()
    assert len(find_logs([tmp_path])) == 10_000
    assert time.process_time() - since < 0.7
