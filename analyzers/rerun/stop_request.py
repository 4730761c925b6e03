"""A request to stop, made by a signal: Ctrl-C, a supervisor's SIGTERM, or a terminal that closes."""

from __future__ import annotations

import signal
import threading
from typing import Any, Final, Self

_SIGNALS: Final = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name)
)


class StopRequest:
    """Handles signals inside a `with` block: the first is a request to stop, a second one acts as it would otherwise.

    They are handled even where the process that started this one had it ignore them, as a shell does with SIGINT for
    what it runs in the background. Only the main thread can handle signals; elsewhere none is handled.
    """

    def __init__(self) -> None:
        self._requested = threading.Event()
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            self._before = {number: signal.signal(number, self._request_stop) for number in _SIGNALS}
        return self

    def __exit__(self, *_: object) -> None:
        self._restore()

    def wait(self, seconds: float) -> bool:
        """Wait for some seconds or until a stop is requested; return whether it was requested."""
        return self._requested.wait(seconds)

    def _request_stop(self, *_: object) -> None:
        self._requested.set()
        self._restore()

    def _restore(self) -> None:
        while self._before:
            signal.signal(*self._before.popitem())
