"""`hrclog view`: what it opens, what it says of what it does not open, and following runs from the command line."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hrclog.analyzers.rerun import viewer
from hrclog.analyzers.rerun.viewer import free_port
from hrclog.events import Heartbeat, RunStarted
from hrclog.log.writing.writer import write_log
from hrclog.recorders.recorder import Recorder

Run = Callable[..., Any]

LISTEN = """#!{python}
import socket, sys, time
with socket.create_server(("127.0.0.1", int(sys.argv[sys.argv.index("--port") + 1]))):
    time.sleep({seconds})
sys.exit({code})
"""


def listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


needs_scripts = pytest.mark.skipif(sys.platform == "win32", reason="needs a script that the system runs")


@pytest.fixture(autouse=True)
def quiet(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let what the command sets for Rerun end with the test."""
    monkeypatch.setenv("RUST_LOG", "off")


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Return a list that takes what would be opened in a viewer."""
    paths: list[Path] = []

    def take(recordings: tuple[Path, ...], _web_port: int | None) -> int:
        paths.extend(recordings)
        return 0

    monkeypatch.setattr(viewer, "open_viewer", take)
    monkeypatch.setattr(viewer, "has_display", lambda: True)
    return paths


@pytest.fixture
def stub(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[[float, int], None]:
    """Return what puts a program in the viewer's place, which ends after some seconds with some code."""
    monkeypatch.setattr(viewer, "has_display", lambda: True)
    path = tmp_path / "bin" / "rerun"
    monkeypatch.setattr(viewer, "viewer_path", lambda: str(path))

    def put(seconds: float, code: int) -> None:
        path.parent.mkdir()
        path.write_text(LISTEN.format(python=sys.executable, seconds=seconds, code=code))
        path.chmod(path.stat().st_mode | stat.S_IXUSR)

    return put


@pytest.mark.parametrize(
    "options",
    [
        ("--until-idle", "3"),
        ("--live", "--run", "x"),
        ("--live", "-o", "out"),
        ("--live", "--until-idle", "0"),
        ("--live", "--every", "0"),
        ("--web", "--port", "0"),
    ],
)
def test_options_that_do_not_go_together_are_wrong_usage(options: tuple[str, ...], run: Run, tmp_path: Path) -> None:
    result = run("view", tmp_path, *options)
    assert result.code == 2
    assert "Error:" in result.err


def test_a_run_cannot_be_chosen_within_a_recording(run: Run, tmp_path: Path) -> None:
    (tmp_path / "one.rrd").write_bytes(b"RRF2")
    assert run("view", tmp_path / "one.rrd", "--run", "x").code == 2


def test_following_a_folder_that_is_not_there_is_one_clear_sentence(run: Run, tmp_path: Path) -> None:
    result = run("view", "--live", tmp_path / "gone")
    assert result.code == 1
    expected = "found nothing, expected a folder into which runs are recorded; make it, or name another"
    assert result.err == f"hrclog: error: {tmp_path / 'gone'}: {expected}\n"


def test_following_without_a_display_suggests_the_web(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(viewer, "has_display", lambda: False)
    result = run("view", "--live", tmp_path)
    assert result.code == 1
    assert "use --web" in result.err
    assert len(result.err.splitlines()) == 1


def test_a_port_that_is_taken_is_one_clear_sentence(run: Run, tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        result = run("view", "--live", tmp_path, "--web", "--port", port)
    assert result.code == 1
    assert f"port {port} is taken" in result.err
    assert "--port" in result.err


@needs_scripts
def test_closing_the_viewer_ends_the_command(run: Run, tmp_path: Path, stub: Callable[[float, int], None]) -> None:
    stub(1, 0)
    (tmp_path / "runs").mkdir()
    result = run("view", "--live", tmp_path / "runs", "--every", "0.05")
    assert (result.code, result.err) == (0, "followed 0 runs, 0 ended\n")


@needs_scripts
def test_a_viewer_that_breaks_down_is_a_failure(run: Run, tmp_path: Path, stub: Callable[[float, int], None]) -> None:
    stub(0.5, 3)
    (tmp_path / "runs").mkdir()
    result = run("view", "--live", tmp_path / "runs", "--every", "0.05")
    assert result.code == 1
    assert result.err.splitlines()[-1] == "hrclog: error: the Rerun viewer ended with code 3"


@needs_scripts
def test_a_folder_that_is_deleted_meanwhile_ends_the_command_with_one_clear_sentence(
    run: Run, tmp_path: Path, stub: Callable[[float, int], None]
) -> None:
    stub(60, 0)
    (tmp_path / "runs").mkdir()
    threading.Timer(1, shutil.rmtree, [tmp_path / "runs"]).start()
    result = run("view", "--live", tmp_path / "runs", "--every", "0.05")
    assert result.code == 1
    assert result.err.splitlines()[0] == "followed 0 runs, 0 ended"
    assert "found nothing, expected a folder into which runs are recorded" in result.err.splitlines()[1]


@pytest.mark.slow
def test_a_run_is_followed_to_its_end_and_what_is_not_drawn_is_said(run: Run, samples: Path, tmp_path: Path) -> None:
    for path in sorted((samples / "campaign").glob("*.mcap"))[:5]:
        shutil.copy(path, tmp_path)

    def record() -> None:
        with Recorder(tmp_path / "live.mcap", run="a live run") as recorder:
            for _ in range(10):
                with recorder.task("robot", "pick"):
                    time.sleep(0.1)

    recording = threading.Thread(target=record)
    recording.start()
    result = run("view", "--live", tmp_path, "--web", "--port", str(free_port()), "--until-idle", "1.5")
    recording.join()
    assert result.code == 0
    lines = result.err.splitlines()
    assert lines[0].startswith("open http://127.0.0.1:")
    assert lines[1:] == [
        "2 earlier runs are in the statistics, not drawn: hrclog view FILE shows one",
        "followed 1 run, 1 ended",
    ]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="sends SIGINT")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_ends_following_in_peace(number: signal.Signals, tmp_path: Path) -> None:
    port = free_port()
    recorder = Recorder(tmp_path / "run.mcap")
    recorder.start("robot", "pick")
    process = subprocess.Popen(
        [sys.executable, "-m", "hrclog", "view", "--live", str(tmp_path), "--web", "--port", str(port)],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        until = time.monotonic() + 60
        while not listens(port):
            assert time.monotonic() < until
            time.sleep(0.1)
        assert process.stderr is not None
        first = process.stderr.readline()
        time.sleep(3)
        process.send_signal(number)
        _, err = process.communicate(timeout=120)
    finally:
        process.kill()
        recorder.close()
    assert process.returncode == 0
    assert first
    assert err.splitlines() == ["followed 1 run, 0 ended"]
    assert not listens(port)  # the viewer has gone too


def processes_of(path: Path) -> list[str]:
    """Return the command lines of the processes that were given a path."""
    commands = []
    for process in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):  # it has ended meanwhile
            commands.append(process.read_bytes().replace(b"\0", b" ").decode(errors="replace"))
    return [command for command in commands if str(path) in command]


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="looks for processes in /proc")
@pytest.mark.parametrize(
    ("number", "ignored"), [(signal.SIGINT, False), (signal.SIGINT, True), (signal.SIGTERM, False)], ids=str
)
def test_a_signal_ends_a_viewer_in_the_browser_with_its_server(
    number: signal.Signals, ignored: bool, samples: Path, run: Run, tmp_path: Path
) -> None:
    recording = tmp_path / "analysis.rrd"
    assert run("analyze", samples / "single.mcap", "-o", tmp_path, "--recordings", "0").code == 0
    port = free_port()
    as_in_the_background = ["sh", "-c", 'trap "" INT; exec "$@"', "sh"] if ignored else []
    process = subprocess.Popen(
        [*as_in_the_background, sys.executable, "-m", "hrclog", "view", recording, "--web", "--port", str(port)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        until = time.monotonic() + 60
        while not listens(port):
            assert time.monotonic() < until
            time.sleep(0.1)
        process.send_signal(number)
        assert process.wait(30) == 0
    finally:
        process.kill()
    assert processes_of(recording) == []
    assert not listens(port)


@pytest.mark.slow
def test_of_a_folder_of_logs_some_runs_are_drawn_and_the_others_said(
    run: Run, samples: Path, tmp_path: Path, opened: list[Path]
) -> None:
    logs = tmp_path / "logs"
    logs.mkdir()
    for number in range(22):
        recorder = Recorder(logs / f"run_{number:02}.mcap")
        with recorder.task("A", "x"), recorder.task("B", "y"):
            pass
        recorder.close()
    result = run("view", logs, "-o", tmp_path / "out")
    assert result.code == 0
    assert "opening 20 of 22 runs, evenly spread; --run NAME chooses" in result.err
    assert [path.name for path in opened[-1:]] == ["analysis.rrd"]
    assert len(opened) == 21
    assert all(path.is_file() for path in opened)
    opened.clear()
    assert run("view", logs, "-o", tmp_path / "some", "--run", "run_0?", "--run", "21").code == 0
    assert [path.stem for path in opened] == ["analysis", "run_21", *(f"run_0{number}" for number in range(9, -1, -1))]
    result = run("view", logs, "-o", tmp_path / "none", "--run", "nothing")
    assert result.code == 1
    assert "no run with 'nothing' in its name, expected one of run_00, run_01" in result.err
    opened.clear()
    assert run("view", samples / "single.mcap").code == 0
    assert [path.stem for path in opened] == ["paper_0000", "analysis"]


def test_a_log_without_events_or_agents_is_said_not_opened(run: Run, tmp_path: Path, opened: list[Path]) -> None:
    write_log(tmp_path / "empty.mcap", [])
    write_log(tmp_path / "nobody.mcap", [RunStarted(time_ns=1, run_id="r"), Heartbeat(time_ns=2, run_id="r", seq=1)])
    for name, found in (("empty", "no events"), ("nobody", "events of no agent")):
        result = run("view", tmp_path / f"{name}.mcap", "-o", tmp_path / "out")
        assert result.code == 1
        expected = f"found {found}, expected agents that do something; hrclog info"
        assert expected in result.err
    assert opened == []


def test_what_is_no_recording_is_said_not_opened(run: Run, tmp_path: Path, opened: list[Path]) -> None:
    (tmp_path / "bad.rrd").write_bytes(b"")
    result = run("view", tmp_path / "bad.rrd", "--web")
    assert result.code == 1
    assert "found an empty file, expected a Rerun recording" in result.err
    assert opened == []


def test_help_of_view_imports_nothing_heavy() -> None:
    code = "import sys; from hrclog.cli import main; main(['view', '--help']); print(*sorted(sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=dict(os.environ)
    )
    modules = {name.split(".")[0] for name in done.stdout.splitlines()[-1].split()}
    assert not modules & {"numpy", "polars", "rerun", "pyarrow", "matplotlib"}
