"""A process that dies at any change it makes to files, played in this process."""

from __future__ import annotations

import builtins
import io
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, Self

import pytest

CHANGES = ("replace", "rename", "unlink", "remove", "mkdir", "rmdir", "link", "ftruncate", "fsync", "write")
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC


class Died(BaseException):
    """The process is dead: whatever it still tries to do comes to nothing."""


class Dying:
    """Counts changes to files, and lets none happen after a given number of them; a last write may be torn.

    Args:
        patch: undone at the end of the test.
        after: how many changes happen; None for all.
    """

    def __init__(self, patch: pytest.MonkeyPatch, after: int | None = None) -> None:
        self.count = 0
        self.after = after
        for name in CHANGES:
            patch.setattr(os, name, self._mortal(getattr(os, name)))
        patch.setattr(os, "open", self._mortal(os.open, changes=lambda flags, *_, **__: bool(flags & _WRITING)))
        for owner in (io, builtins):
            patch.setattr(owner, "open", self._mortal_open(owner.open))

    def change(self) -> None:
        """Count a change to a file, or die."""
        if self.after is not None and self.count >= self.after:
            raise Died
        self.count += 1

    def _mortal(
        self, function: Callable[..., Any], changes: Callable[..., bool] = lambda *_, **__: True
    ) -> Callable[..., Any]:
        def call(first: object, *rest: Any, **named: Any) -> Any:  # noqa: ANN401 - as the function it stands for
            if changes(*rest, **named):
                self.change()
            return function(first, *rest, **named)

        return call

    def _mortal_open(self, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(file: object, mode: str = "r", *rest: Any, **named: Any) -> Any:  # noqa: ANN401 - as `open`
            if not set(mode) & set("wax+"):
                return function(file, mode, *rest, **named)
            self.change()
            return _Stream(function(file, mode, *rest, **named), self)

        return call


class _Stream:
    """A file whose writes are changes; the one at which the process dies is done by half."""

    def __init__(self, stream: IO[Any], dying: Dying) -> None:
        self._stream = stream
        self._dying = dying

    def write(self, data: Any) -> int:  # noqa: ANN401 - text or bytes
        try:
            self._dying.change()
        except Died:
            self._stream.write(data[: len(data) // 2])
            raise
        return self._stream.write(data)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()

    def __iter__(self) -> Any:  # noqa: ANN401 - as of the stream
        return iter(self._stream)

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - as of the stream
        return getattr(self._stream, name)


def die(work: Callable[[], object], after: int | None) -> int:
    """Work until so many changes to files are made; return how many there were."""
    with pytest.MonkeyPatch.context() as patch:
        dying = Dying(patch, after)
        with suppress(Died):
            work()
        return dying.count


def contents(folder: Path) -> dict[str, bytes]:
    """Return the bytes of the files below a folder that are not hidden, nor in a hidden folder."""
    files = {path.relative_to(folder): path for path in sorted(folder.rglob("*")) if path.is_file()}
    return {
        name.as_posix(): path.read_bytes()
        for name, path in files.items()
        if not any(part.startswith(".") for part in name.parts)
    }
