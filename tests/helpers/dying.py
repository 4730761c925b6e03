"""A process that dies between any two changes it makes to files, played in this process."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest


class Died(BaseException):
    """The process is dead: whatever it still tries to do comes to nothing."""


class Dying:
    """Counts changes to files, and lets none happen after a given number of them.

    Args:
        patch: undone at the end of the test.
        after: how many changes happen; None for all.
    """

    def __init__(self, patch: pytest.MonkeyPatch, after: int | None = None) -> None:
        self.count = 0
        self.after = after
        for owner, name in (
            *((Path, name) for name in ("replace", "rename", "unlink", "mkdir", "rmdir", "write_bytes", "write_text")),
            (os, "fsync"),
        ):
            patch.setattr(owner, name, self._mortal(getattr(owner, name)))
        patch.setattr(Path, "open", self._mortal(Path.open, changes=lambda mode="r", *_, **__: mode != "r"))

    def _mortal(
        self, function: Callable[..., Any], changes: Callable[..., bool] = lambda *_, **__: True
    ) -> Callable[..., Any]:
        def call(first: object, *rest: Any, **named: Any) -> Any:  # noqa: ANN401 - as the function it stands for
            if changes(*rest, **named):
                if self.after is not None and self.count >= self.after:
                    raise Died
                self.count += 1
            return function(first, *rest, **named)

        return call
