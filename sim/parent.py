"""Workers that end with the process that started them, even where that was killed."""

from __future__ import annotations

import os
from functools import cache
from multiprocessing import parent_process
from multiprocessing.connection import wait
from threading import Thread


@cache
def end_with_parent() -> None:
    """Let this process, a worker, end at once when its parent has; without it, it would wait for work for ever."""
    parent = parent_process()
    if parent is not None:
        Thread(target=_watch, args=(parent.sentinel,), daemon=True).start()


def _watch(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)
