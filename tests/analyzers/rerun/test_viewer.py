"""Which program shows recordings, and which recordings: whatever is wrong is one clear sentence."""

from __future__ import annotations

import os
import signal
import socket
import stat
import sys
import time
from importlib.metadata import version
from pathlib import Path
from urllib.request import urlopen

import pytest
from rerun import RecordingStream, TextDocument

from hrclog.analyzers.rerun import viewer
from hrclog.analyzers.rerun.selection import recordings_at
from hrclog.analyzers.rerun.viewer import (
    check_recording,
    check_viewer,
    free_port,
    open_viewer,
    running_viewer,
    viewer_path,
)
from hrclog.errors import HrclogError, LogReadError

PYTHON = sys.executable
NAMES = [f"paper_{number:04}" for number in range(25)]


def program(folder: Path, body: str) -> Path:
    """Write a program called rerun."""
    folder.mkdir(exist_ok=True)
    path = folder / "rerun"
    path.write_text(f"#!{PYTHON}\n{body}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


@pytest.fixture
def nothing_beside(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Let Python stand in a folder without a viewer, and return the only folder on the PATH."""
    monkeypatch.setattr(sys, "executable", str(tmp_path / "bin" / "python"))
    monkeypatch.setenv("PATH", str(tmp_path / "path"))
    return tmp_path / "path"


def recording(path: Path) -> Path:
    rec = RecordingStream("some", recording_id="one", send_properties=False)
    memory = rec.memory_recording()
    rec.log("/about", TextDocument("# hello"), static=True)
    path.write_bytes(memory.drain_as_bytes())
    rec.disconnect()
    return path


def test_without_a_viewer_it_is_said_how_to_get_one(nothing_beside: Path) -> None:
    assert not nothing_beside.exists()
    with pytest.raises(HrclogError, match=r"found no Rerun viewer, expected .*; pip install rerun-sdk"):
        viewer_path()


def test_the_viewer_beside_this_python_is_taken_before_any_other(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(program(tmp_path, "raise SystemExit(1)").parent), prepend=os.pathsep)
    assert Path(viewer_path()).parent == Path(sys.executable).parent


@pytest.mark.skipif(sys.platform == "win32", reason="needs a script that the system runs")
@pytest.mark.parametrize(
    ("says", "found"), [("rerun-cli 0.30.1 (some)", "0.30.1"), ("", "of unknown version"), ("rerun 1.41.0", "1.41.0")]
)
def test_a_viewer_of_another_version_is_named_with_both_versions(says: str, found: str, nothing_beside: Path) -> None:
    path = program(nothing_beside, f"print({says!r})")
    with pytest.raises(HrclogError) as caught:
        viewer_path()
    own = version("rerun-sdk")
    assert f"found the Rerun viewer {found} at {path}, expected {own}" in str(caught.value)
    assert f"pip install rerun-sdk=={own}" in str(caught.value)


@pytest.mark.skipif(sys.platform == "win32", reason="needs a script that the system runs")
def test_a_viewer_on_the_path_may_differ_in_its_last_number(nothing_beside: Path) -> None:
    own = ".".join(version("rerun-sdk").split(".")[:2])
    path = program(nothing_beside, f"print('rerun-cli {own}.77 (some)')")
    assert viewer_path() == str(path)


def test_a_port_that_is_taken_is_named() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(HrclogError, match=rf"port {port} is taken, .*--port"):
            check_viewer(web_port=port)
    check_viewer(web_port=free_port())


def test_without_a_display_the_web_is_suggested(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewer, "has_display", lambda: False)
    with pytest.raises(HrclogError, match=r"found no display, .*use --web"):
        check_viewer()
    check_viewer(web_port=free_port())


def test_a_whole_recording_is_one(tmp_path: Path) -> None:
    check_recording(recording(tmp_path / "one.rrd"))


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (b"", "an empty file"),
        (b"hello", "a file that begins with b'hel'"),
        (b"RRF2" + bytes(200), "a recording of 204 bytes without its end"),
    ],
)
def test_what_is_no_recording_is_said(content: bytes, found: str, tmp_path: Path) -> None:
    (tmp_path / "bad.rrd").write_bytes(content)
    with pytest.raises(LogReadError) as caught:
        check_recording(tmp_path / "bad.rrd")
    assert str(caught.value).startswith(f"{tmp_path / 'bad.rrd'}: found {found}")


def test_a_recording_that_was_cut_off_or_is_gone_is_said(tmp_path: Path) -> None:
    path = recording(tmp_path / "cut.rrd")
    path.write_bytes(path.read_bytes()[:-80])
    with pytest.raises(LogReadError, match="without its end: cut off"):
        check_viewer([path], web_port=free_port())
    with pytest.raises(LogReadError, match="cannot be opened"):
        check_recording(tmp_path / "gone.rrd")


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """Return a folder like that of an analysis of 25 runs, the first two of which were not drawn."""
    (tmp_path / "runs").mkdir()
    (tmp_path / "analysis.rrd").write_bytes(b"RRF2")
    for name in NAMES[2:]:
        (tmp_path / "runs" / f"{name}.rrd").write_bytes(b"RRF2")
    rows = ", ".join(f'{{"name": "{name}"}}' for name in NAMES)
    (tmp_path / "analysis.json").write_text(f'{{"runs": [{rows}]}}')
    return tmp_path


def test_of_many_runs_the_first_are_opened_and_the_others_named(results: Path) -> None:
    chosen = recordings_at(results)
    assert chosen is not None
    assert [path.stem for path in chosen.paths] == [*NAMES[2:22], "analysis"]  # a viewer shows the last
    left_out = "left out: 3, paper_0022 .. paper_0024"
    assert chosen.note == f"opening 20 of 23 recordings of the 25 runs; {left_out}; --run NAME chooses"


def test_few_runs_are_all_opened_and_those_never_drawn_are_counted(results: Path) -> None:
    for name in NAMES[5:]:
        (results / "runs" / f"{name}.rrd").unlink()
    chosen = recordings_at(results)
    assert chosen is not None
    assert len(chosen.paths) == 4
    assert chosen.note == "3 of 25 runs have recordings; hrclog analyze --recordings all draws each"
    (results / "analysis.json").unlink()
    again = recordings_at(results)
    assert again is not None
    assert again.note == ""


@pytest.mark.parametrize(
    ("patterns", "numbers"), [(["0003"], [3]), (["*1?"], range(10, 20)), (["PAPER_0024", "0004"], [4, 24])]
)
def test_runs_are_chosen_by_part_of_their_name_or_a_glob(
    patterns: list[str], numbers: list[int], results: Path
) -> None:
    chosen = recordings_at(results, patterns)
    assert chosen is not None
    assert [path.stem for path in chosen.paths] == ["analysis", *(NAMES[number] for number in reversed(numbers))]
    assert chosen.note == ""


def test_a_run_that_is_not_there_is_said_and_one_that_was_not_drawn_too(results: Path) -> None:
    with pytest.raises(
        LogReadError, match=r"no run with 'x' or 'y' in its name, expected one of paper_0002, .* 18 more"
    ):
        recordings_at(results, ["x", "y"])
    with pytest.raises(LogReadError, match=r"no recording of paper_0001, .*--recordings all"):
        recordings_at(results, ["0001"])


def test_what_is_no_analysis_is_to_be_analysed_or_is_missing(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(b"x")
    assert recordings_at(tmp_path) is None
    assert recordings_at(tmp_path / "run.mcap") is None
    with pytest.raises(LogReadError, match=r"found nothing, expected a log, an \.rrd"):
        recordings_at(tmp_path / "gone")


@pytest.fixture
def stub(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Return a folder into which a program called rerun is put, which is taken for the viewer."""
    monkeypatch.setattr(viewer, "viewer_path", lambda: str(tmp_path / "rerun"))
    monkeypatch.setattr(viewer, "has_display", lambda: True)
    return tmp_path


LISTEN = """
import socket, subprocess, sys, time
port = int(sys.argv[sys.argv.index("--port") + 1])
if "child" not in sys.argv:
    sys.exit(subprocess.call([sys.executable, *sys.argv, "child"]))
with socket.create_server(("127.0.0.1", port)):
    time.sleep({seconds})
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs a script that the system runs")
def test_a_viewer_is_closed_at_the_end_with_all_that_it_started(stub: Path) -> None:
    program(stub, LISTEN.format(seconds=60))
    with running_viewer() as running:
        assert running.is_open()
        assert running.page == ""
        port = int(running.url.removeprefix("rerun+http://127.0.0.1:").removesuffix("/proxy"))
        socket.create_connection(("127.0.0.1", port)).close()
    assert not running.is_open()
    until = time.monotonic() + 10
    while time.monotonic() < until:
        try:
            socket.create_connection(("127.0.0.1", port)).close()
        except OSError:
            return
        time.sleep(0.05)
    pytest.fail("the viewer still listens")


@pytest.mark.skipif(sys.platform == "win32", reason="needs a script that the system runs")
@pytest.mark.parametrize("code", [0, 3])
def test_recordings_are_open_until_the_viewer_ends(code: int, stub: Path, capfd: pytest.CaptureFixture[str]) -> None:
    program(stub, f"import sys; print(*sys.argv[1:]); sys.exit({code})")
    path = recording(stub / "one.rrd")
    assert open_viewer([path]) == code
    shown = capfd.readouterr().out.split()
    assert shown[:4] == [str(path), "--bind", "127.0.0.1", "--port"]
    assert "--serve-web" not in shown


@pytest.mark.skipif(sys.platform == "win32", reason="needs a script that the system runs")
def test_an_interrupt_closes_the_viewer_in_peace(stub: Path) -> None:
    program(stub, f"import os, time; os.kill({os.getpid()}, 2); time.sleep(60)")
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # it may be ignored here
    try:
        began = time.monotonic()
        assert open_viewer([recording(stub / "one.rrd")], free_port()) == 0
        assert time.monotonic() - began < 20
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.skipif(sys.platform == "win32", reason="needs a script that the system runs")
def test_a_viewer_that_somebody_closes_is_noticed(stub: Path) -> None:
    program(stub, LISTEN.format(seconds=1))
    with running_viewer() as running:
        until = time.monotonic() + 10
        while running.is_open() and time.monotonic() < until:
            time.sleep(0.05)
        assert running.process.poll() == 0


@pytest.mark.skipif(sys.platform == "win32", reason="needs a script that the system runs")
def test_a_viewer_that_does_not_start_says_why(stub: Path) -> None:
    program(stub, 'import sys\nsys.exit("\\x1b[31mno graphics adapter\\x1b[0m")')
    with (
        pytest.raises(HrclogError, match="viewer ended with code 1 while it started: no graphics adapter"),
        running_viewer(),
    ):
        pass


@pytest.mark.slow
def test_the_page_for_browsers_is_served_where_it_says() -> None:
    port = free_port()
    with running_viewer(port) as running:
        assert running.page.startswith(f"http://127.0.0.1:{port}?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A")
        with urlopen(f"http://127.0.0.1:{port}") as answer:
            assert b"<html" in answer.read().lower()
