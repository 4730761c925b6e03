"""Open recordings in the Rerun viewer, which comes with the rerun-sdk package."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import IO, Final
from urllib.parse import quote

from hrclog.analyzers.rerun.stop_request import StopRequest
from hrclog.errors import HrclogError, LogReadError
from hrclog.wording import counted

HOST: Final = "127.0.0.1"

_MAGIC: Final = b"RRF"
_FOOTER: Final = b"RRF2FOOT"
_FOOTER_BYTES: Final = 64  # at the end, among which its mark stands
_START_S: Final = 60.0
_STOP_S: Final = 10.0
_GROUP_STOP_S: Final = 2.0  # once the first process of the viewer has ended
_LOOK_S: Final = 0.1


@dataclass(frozen=True, slots=True)
class RunningViewer:
    """A viewer that takes recordings over the network.

    Attributes:
        url: where recordings are sent.
        page: the address of its page for browsers, "" for a window.
        process: of its own process group.
    """

    url: str
    page: str
    process: subprocess.Popen[bytes]

    def is_open(self) -> bool:
        """Return whether the viewer is still open."""
        return self.process.poll() is None


def open_viewer(recordings: Sequence[Path], web_port: int | None = None) -> int:
    """Open recordings in a window, or serve them to a browser, until the viewer is closed; return its exit code.

    A signal that asks to stop (Ctrl-C, SIGTERM) closes the viewer, with all processes that it has started; that is 0.

    Raises:
        HrclogError: there is no viewer, no display to open a window on, or the port is taken.
    """
    check_viewer(recordings, web_port)
    command = [viewer_path(), *map(str, recordings), "--bind", HOST, "--port", str(free_port())]
    if web_port is not None:
        command += ["--serve-web", "--web-viewer-port", str(web_port)]
    # in its own process group, because the program `rerun` starts another one
    with StopRequest() as stop:
        process = subprocess.Popen(command, start_new_session=True)  # noqa: S603 - our own interpreter and the user's paths
        try:
            return _exit_code(process, stop)
        except KeyboardInterrupt:  # a second Ctrl-C
            return 0
        finally:
            _stop(process)


@contextmanager
def running_viewer(web_port: int | None = None) -> Iterator[RunningViewer]:
    """Yield an empty viewer, in a window or served to browsers, and close it at the end.

    Raises:
        HrclogError: there is no viewer, no display to open a window on, the port is taken, or it does not start.
    """
    check_viewer((), web_port)
    port = free_port()
    command = [viewer_path(), "--bind", HOST, "--port", str(port)]
    page = ""
    if web_port is None:
        command += ["--hide-welcome-screen"]
    else:
        command += ["--serve-web", "--web-viewer-port", str(web_port)]
        page = f"http://{HOST}:{web_port}?url={quote(f'rerun+http://{HOST}:{port}/proxy', safe='')}"
    with tempfile.TemporaryFile() as output:
        process = subprocess.Popen(command, stdout=output, stderr=output, start_new_session=True)  # noqa: S603 - our own interpreter
        try:
            _wait_for([port] if web_port is None else [port, web_port], process, output)
            yield RunningViewer(f"rerun+http://{HOST}:{port}/proxy", page, process)
        finally:
            _stop(process)


def check_viewer(recordings: Sequence[Path] = (), web_port: int | None = None) -> None:
    """Raise if recordings cannot be shown.

    Args:
        recordings: what is to be opened, if it exists already.
        web_port: of the page for browsers, None for a window.

    Raises:
        HrclogError: there is no viewer, it is of another version, there is no display to open a window on, the port is
            taken, or a file is no recording.
    """
    for recording in recordings:
        check_recording(recording)
    viewer_path()
    if web_port is None and not has_display():
        first = recordings[0] if recordings else "the .rrd files that `hrclog analyze` writes"
        remedy = f"use --web, or open {first} on a desktop machine"
        raise HrclogError(f"found no display, expected one to open a window on; {remedy}")
    if web_port is not None and not _is_free(web_port):
        raise HrclogError(
            f"port {web_port} is taken, expected a free one to serve the viewer at; choose one with --port"
        )


def check_recording(path: Path) -> None:
    """Raise if a file is no recording that can be opened.

    Raises:
        LogReadError: the file is something else, which the error names.
    """
    try:
        with path.open("rb") as stream:
            head = stream.read(len(_MAGIC))
            size = stream.seek(0, os.SEEK_END)
            stream.seek(max(size - _FOOTER_BYTES, 0))
            tail = stream.read()
    except OSError as error:
        problem = f"a file that cannot be opened ({error.strerror})"
        raise LogReadError(path, problem, "a Rerun recording", "check the path and its permissions") from error
    remedy = "make it again with `hrclog analyze`"
    if not size:
        raise LogReadError(path, "an empty file", "a Rerun recording", remedy)
    if head != _MAGIC:
        raise LogReadError(path, f"a file that begins with {head!r}", "a Rerun recording", remedy)
    if _FOOTER not in tail:
        why = "cut off, still being written, or of an old version"
        problem = f"a recording of {counted(size, 'byte')} without its end: {why}"
        raise LogReadError(path, problem, "a whole one", f"{remedy}, or see what is there with `rerun {path}`")


def viewer_path() -> str:
    """Return the viewer's program: the one beside this Python, else the one on the PATH.

    Raises:
        HrclogError: there is no viewer, or its version differs from that of the rerun-sdk package.
    """
    # `python -m rerun_cli` would hide the viewer's exit code
    bundled = shutil.which("rerun", path=str(Path(sys.executable).parent))
    program = bundled or shutil.which("rerun")
    if program is None:
        raise HrclogError("found no Rerun viewer, expected the one of the rerun-sdk package; pip install rerun-sdk")
    if bundled is None:
        _check_version(program)
    return program


def has_display() -> bool:
    """Return whether a window can be opened."""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def free_port() -> int:
    """Return a port on which nothing listens now."""
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        port: int = probe.getsockname()[1]
        return port


def _check_version(program: str) -> None:
    expected = version("rerun-sdk")
    try:
        result = subprocess.run([program, "--version"], capture_output=True, text=True, check=False, timeout=_START_S)  # noqa: S603 - found on the user's PATH
        match = re.search(r"\d+\.\d+\.\d+", result.stdout)
    except (OSError, subprocess.SubprocessError):
        match = None
    actual = match[0] if match else "of unknown version"
    if actual.split(".")[:2] != expected.split(".")[:2]:
        remedy = f"pip install rerun-sdk=={expected} where {program} comes from, or beside this Python"
        raise HrclogError(
            f"found the Rerun viewer {actual} at {program}, expected {expected} as the rerun-sdk here; {remedy}"
        )


def _is_free(port: int) -> bool:
    with socket.socket() as probe:
        if sys.platform != "win32":  # where it would take a port from somebody
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError:
            return False
    return True


def _wait_for(ports: Sequence[int], process: subprocess.Popen[bytes], output: IO[bytes]) -> None:
    """Wait until a viewer listens.

    Raises:
        HrclogError: the viewer ends before it listens, or takes too long.
    """
    until = time.monotonic() + _START_S
    for port in ports:
        while not _listens(port):
            if process.poll() is not None or time.monotonic() > until:
                output.seek(0)
                lines = [line for line in output.read().decode(errors="replace").splitlines() if line.strip()]
                reason = re.sub(r"\x1b\[\d*m", "", lines[-1])[-200:] if lines else "it said nothing"
                failure = (
                    f"ended with code {process.returncode}" if process.returncode is not None else "did not answer"
                )
                raise HrclogError(f"the Rerun viewer {failure} while it started: {reason}")
            time.sleep(0.05)


def _listens(port: int) -> bool:
    try:
        with socket.create_connection((HOST, port), 0.5):
            return True
    except OSError:
        return False


def _exit_code(process: subprocess.Popen[bytes], stop: StopRequest) -> int:
    """Wait until a viewer ends, or a stop is requested; return its exit code, or 0."""
    while (code := process.poll()) is None:
        if stop.wait(_LOOK_S):
            return 0
    return code


def _stop(process: subprocess.Popen[bytes]) -> None:
    """End a viewer and all processes that it has started."""
    for number in (signal.SIGTERM, getattr(signal, "SIGKILL", signal.SIGTERM)):
        with contextlib.suppress(ProcessLookupError):
            if sys.platform == "win32":
                process.terminate()
            else:
                os.killpg(process.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(_STOP_S)
            if _group_ends(process.pid):
                return


def _group_ends(group: int) -> bool:
    """Wait a moment for the other processes of a group; return whether none is left."""
    until = time.monotonic() + _GROUP_STOP_S
    while sys.platform != "win32" and time.monotonic() < until:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.02)
    return sys.platform == "win32"
