"""The same function over many items, in this process or in several, with results in order."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures import wait as wait_for
from multiprocessing import get_context
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


def ordered_map(function: Callable[[T], R], items: Sequence[T], workers: int = 1) -> Iterator[R]:
    """Yield the result of each item, in the order of the items.

    Args:
        function: with several workers it and the items are pickled.
        items: what to work on.
        workers: processes to use; 1 works in this one.
    """
    if workers == 1 or len(items) < 2:
        yield from map(function, items)
        return
    # spawned, not forked: the parent may hold threads (polars, a web server) that do not survive a fork
    with ProcessPoolExecutor(min(workers, len(items)), mp_context=get_context("spawn")) as pool:
        futures = [pool.submit(function, item) for item in items]
        try:
            for future in futures:
                yield future.result()
        except BaseException:
            for future in futures:
                future.cancel()
            wait_for(futures)
            raise
