"""Work for other processes, which import it from here: test modules are none that they could find."""

from __future__ import annotations

import os
import time
from pathlib import Path

from hrclog.errors import HrclogError


def doubled(number: int) -> int:
    time.sleep(0.05 if number % 2 == 0 else 0.0)  # the later ones are done first
    return 2 * number


def process(number: int) -> tuple[int, int]:
    return number, os.getpid()


def refused(number: int) -> int:
    if number == 1:
        raise HrclogError(f"{number} is refused")
    return number


def noted(folder: Path, number: int) -> int:
    if number == 0:
        raise HrclogError("the first is refused")
    time.sleep(0.05)
    (folder / f"{number}").touch()
    return number


def told(folder: Path, number: int) -> int:
    """Leave the process's id in a folder, and take a minute."""
    (folder / f"pid-{os.getpid()}").touch()
    time.sleep(60)
    return number
