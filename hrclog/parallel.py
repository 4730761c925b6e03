"""The same function over many items, in this process or in several, with results in order."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures import wait as wait_for
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait as wait_for_end
from threading import Thread
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


def ordered_map(function: Callable[[T], R], items: Sequence[T], workers: int = 1) -> Iterator[R]:
    """Yield the result of each item, in the order of the items; workers end with this process, even if it is killed.

    Args:
        function: with several workers it and the items are pickled.
        items: what to work on.
        workers: processes to use; 1 works in this one.
    """
    if workers == 1 or len(items) < 2:
        yield from map(function, items)
        return
    # spawned, not forked: the parent may hold threads (polars, a web server) that do not survive a fork
    context, count = get_context("spawn"), min(workers, len(items))
    with ProcessPoolExecutor(count, mp_context=context, initializer=_end_with_parent) as pool:
        futures = [pool.submit(function, item) for item in items]
        try:
            for future in futures:
                yield future.result()
        except BaseException:
            for future in futures:
                future.cancel()
            wait_for(futures)
            raise


def _end_with_parent() -> None:
    """Let this process, a worker, end at once when its parent has; without it, it would wait for work for ever."""
    parent = parent_process()
    if parent is not None:
        Thread(target=_watch, args=(parent.sentinel,), daemon=True).start()


def _watch(sentinel: int) -> None:
    wait_for_end([sentinel])
    os._exit(1)
