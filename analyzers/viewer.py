"""Open recordings in the Rerun viewer, which comes with the rerun-sdk package."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from hrclog.errors import HrclogError, LogReadError

MOST_RUNS: Final = 20
"""How many run recordings a folder opens beside the campaign's."""


def recordings_at(target: Path) -> list[Path] | None:
    """Return the recordings that a target stands for, None where it is to be analysed first.

    Args:
        target: an .rrd, the folder of an analysis, a log or a folder of logs.

    Raises:
        LogReadError: there is nothing.
    """
    if not target.exists():
        raise LogReadError(target, "nothing", "a log, an .rrd or the folder of an analysis", "check the path")
    if target.suffix == ".rrd":
        return [target]
    if target.is_dir():
        found = [*sorted(target.glob("*.rrd")), *sorted(target.glob("runs/*.rrd"))[:MOST_RUNS]]
        return found or None
    return None


def open_viewer(recordings: Sequence[Path], web_port: int | None = None) -> int:
    """Open recordings in a window, or serve them to a browser, until the viewer is closed; return its exit code.

    Raises:
        HrclogError: there is no viewer, or no display to open a window on.
    """
    check_viewer(recordings, web=web_port is not None)
    command = [viewer_path(), *map(str, recordings)]
    if web_port is not None:
        command += ["--serve-web", "--web-viewer-port", str(web_port), "--bind", "127.0.0.1"]
    return subprocess.run(command, check=False).returncode  # noqa: S603 - our own interpreter and the user's paths


def check_viewer(recordings: Sequence[Path], *, web: bool) -> None:
    """Raise if nothing could be shown.

    Raises:
        HrclogError: there is no viewer, or no display to open a window on.
    """
    viewer_path()
    if not web and not has_display():
        first = recordings[0] if recordings else "the .rrd files that `hrclog analyze` writes"
        remedy = f"use --web, or open {first} on a desktop machine"
        raise HrclogError(f"found no display, expected one to open a window on; {remedy}")


def viewer_path() -> str:
    """Return the viewer's program: the one beside this Python, else the one on the PATH.

    Raises:
        HrclogError: there is none.
    """
    # `python -m rerun_cli` would hide the viewer's exit code
    found = shutil.which("rerun", path=str(Path(sys.executable).parent)) or shutil.which("rerun")
    if found is None:
        raise HrclogError("found no Rerun viewer, expected the one of the rerun-sdk package; pip install rerun-sdk")
    return found


def has_display() -> bool:
    """Return whether a window can be opened."""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
