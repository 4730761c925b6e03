"""Frames as files; a full disk is an OSError, whatever polars makes of it."""

from __future__ import annotations

import os
from collections.abc import Callable
from io import FileIO
from pathlib import Path
from typing import Any


def write_by(write: Callable[[Any], object], path: Path) -> None:
    """Let a method of a frame, such as `frame.write_parquet`, write a file.

    Raises:
        OSError: the file cannot be written.
    """
    with path.open("wb", buffering=0) as stream:
        target = _Target(stream)
        try:
            write(target)
        except Exception as error:
            if target.error is None:
                raise
            target.error.filename = os.fspath(path)
            raise target.error from error


class _Target:
    """Takes bytes for a file, and remembers why it could not: polars tells of it by an error of another kind.

    It has no number of an open file, by which polars would write past it.
    """

    def __init__(self, stream: FileIO) -> None:
        self.error: OSError | None = None
        self._stream = stream

    def write(self, data: bytes) -> int:
        left = memoryview(data)
        try:
            while left:  # an unbuffered file may take a part
                left = left[self._stream.write(left) :]
        except OSError as error:
            self.error = error
            raise
        return len(data)

    def flush(self) -> None:
        """Do nothing: no byte waits in a buffer."""
