"""What the operating system offers to keep files whole: locks, syncs and atomic renames."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import IO

from hrclog.errors import LogWriteError

if sys.platform == "win32":  # two recorders of one file exclude each other by its creation alone

    def lock(fd: int, *, wait: bool) -> bool:  # noqa: ARG001 - the same signature everywhere
        """Return True: this system offers no lock."""
        return True

else:
    import fcntl

    def lock(fd: int, *, wait: bool) -> bool:
        """Lock an open file until it is closed; return False where somebody else has it and `wait` is off."""
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            return False
        except OSError:  # a file system without locks
            return True
        return True


def exists(path: Path) -> bool:
    """Return whether a path exists; False also if it is too long or not accessible."""
    try:
        return path.exists()
    except OSError:
        return False


def is_at(fd: int, path: Path) -> bool:
    """Return whether an open file is the one at a path: it may have been removed, or replaced."""
    try:
        return os.path.samestat(os.fstat(fd), path.stat())
    except OSError:
        return False


def sync_folder(folder: Path) -> None:
    """Make the names in a folder survive a crash of the operating system."""
    if os.name != "posix":
        return
    fd = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)


def replace_atomically(path: Path, fill: Callable[[IO[bytes]], object], *, sync_names: bool = True) -> None:
    """Let `fill` write a hidden file, sync it, and rename it to `path`: it is there whole, or not at all.

    Args:
        path: the file.
        fill: writes its bytes.
        sync_names: whether the name, too, survives a crash at once; who writes many files may call `sync_folder` once.

    Raises:
        LogWriteError: the file cannot be written.
    """
    temporary = path.with_name(f".hrclog-{os.getpid()}-{time.monotonic_ns()}.tmp")
    try:
        with temporary.open("xb") as stream:
            fill(stream)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(path)
        if sync_names:
            sync_folder(path.parent)
    except OSError as error:
        reason = f"cannot be written ({error.strerror})"
        raise LogWriteError(path, reason, "choose a folder that can be written") from error
    finally:
        with suppress(OSError):
            temporary.unlink()
