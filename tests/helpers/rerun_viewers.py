"""A real Rerun viewer without a person: started, shown recordings, asked what it thinks of them."""

from __future__ import annotations

import contextlib
import copy
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import pytest
from PIL import Image
from rerun.experimental import ViewerClient

Answer = TypeVar("Answer")

PATIENCE_S = 120
DRIVERS = [Path(folder) for folder in ("/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d")]
OF_THE_MACHINE = (
    *("Software rasterizer", "Docker", "XSETTINGS", "XRandR", "locale", "clipboard", "xkb", "Xft"),
    "Failed to render screenshot",  # in time: it is asked for again
)
"""What a viewer says of where it runs, not of what it shows."""


def need_drivers() -> None:
    """Skip the test where no viewer can draw."""
    if not any(folder.glob("*.json") for folder in DRIVERS):
        pytest.skip("no Vulkan driver, which the headless Rerun viewer needs: apt-get install mesa-vulkan-drivers")


@contextmanager
def viewer_in(folder: Path, size: str = "1000x700", display: str = "") -> Iterator[ViewerClient]:
    """Start a viewer, without a window unless a display is named; its settings and its log go into the folder."""
    need_drivers()
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [str(Path(sys.executable).parent / "rerun"), "--hide-welcome-screen", "--port", str(port)]
    environment = os.environ | {"HOME": str(folder), "XDG_CONFIG_HOME": str(folder), "XDG_RUNTIME_DIR": str(folder)}
    environment |= {"DISPLAY": display} if display else {}
    log = (folder / "viewer.log").open("wb")
    process = subprocess.Popen(
        [*command, *([] if display else ["--headless"]), "--window-size", size],
        stdout=log,
        stderr=log,
        env=environment,
        start_new_session=True,
    )
    try:
        _wait_for(port, process)
        yield ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGTERM)
        process.wait(PATIENCE_S)
        log.close()


@contextmanager
def virtual_display(size: str = "1000x700") -> Iterator[str]:
    """Start an X server without a screen, and give its name."""
    number = next(number for number in range(90, 200) if not Path(f"/tmp/.X11-unix/X{number}").exists())  # noqa: S108 - where X servers have their sockets
    command = ["Xvfb", f":{number}", "-screen", "0", f"{size}x24"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        until = time.monotonic() + PATIENCE_S
        while not Path(f"/tmp/.X11-unix/X{number}").exists():  # noqa: S108 - as above
            assert time.monotonic() < until, "the X server did not start"
            time.sleep(0.1)
        yield f":{number}"
    finally:
        process.terminate()
        process.wait(PATIENCE_S)


def _wait_for(port: int, process: subprocess.Popen[bytes]) -> None:
    until = time.monotonic() + PATIENCE_S
    while process.poll() is None and time.monotonic() < until:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 0.2):
            return
        time.sleep(0.1)
    pytest.fail("the viewer did not start")


def asked(question: Callable[[], Answer]) -> Answer:
    """Return the answer of a viewer; on a busy machine it may take longer than its client waits."""
    for _ in range(9):
        with contextlib.suppress(TimeoutError):
            return question()
    return question()


def state_of(viewer: ViewerClient) -> Any:  # noqa: ANN401 - its client does not name the type
    """Return what a viewer shows."""
    return asked(viewer.get_state)


def show(viewer: ViewerClient, path: Path) -> None:
    """Open a recording and wait until it is drawn."""
    asked(lambda: viewer.open(str(path)))
    until = time.monotonic() + PATIENCE_S
    while (state := state_of(viewer)).loading or not state.views:
        assert time.monotonic() < until, "the recording did not load"
        time.sleep(0.1)
    time.sleep(1)


def tabs(viewer: ViewerClient) -> Iterator[str]:
    """Bring every tab to the front in turn, those within others too, and yield its path."""
    layout = asked(viewer.get_blueprint).blueprint
    holders = {path: parts["ContainerBlueprint"] for path, parts in layout.items() if "contents" in _container(parts)}
    parents = {f"/{part}": path for path, holder in holders.items() for part in holder["contents"]}
    tabbed = {path for path, holder in holders.items() if holder.get("container_kind") == "Tabs"}
    for tab in (part for part, parent in parents.items() if parent in tabbed and part not in tabbed):
        changed = copy.deepcopy(layout)
        part = tab
        while part in parents:
            if parents[part] in tabbed:
                changed[parents[part]]["ContainerBlueprint"]["active_tab"] = part.lstrip("/")
            part = parents[part]
        asked(partial(viewer.set_blueprint, changed, of="recording"))
        _drawn(viewer)
        yield tab


def _container(parts: dict[str, Any]) -> dict[str, Any]:
    container: dict[str, Any] = parts.get("ContainerBlueprint", {})
    return container


def _drawn(viewer: ViewerClient) -> None:
    """Wait until what was asked for is on the screen: a broken picture is told about 0.1 s after its tab came up."""
    time.sleep(0.2)
    for _ in range(3):  # each is answered between two frames
        state_of(viewer)


def complaints(viewer: ViewerClient) -> list[str]:
    """Return what views and log complain of."""
    reports = [f"{view.name}: {report.summary}" for view in state_of(viewer).views for report in view.reports]
    logged = [entry.message for entry in asked(viewer.get_logs) if entry.level != "INFO"]
    return reports + [message for message in logged if not any(word in message for word in OF_THE_MACHINE)]


def colours(viewer: ViewerClient, picture: Path, size: str = "1000x700") -> int:
    """Save a screenshot and return how many colours it has."""
    asked(lambda: viewer.save_screenshot(str(picture)))
    with Image.open(picture) as image:
        assert "{}x{}".format(*image.size) == size
        return len(image.convert("RGB").getcolors(1_000_000) or ())
