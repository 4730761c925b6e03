"""What the operating system offers to keep logs whole."""

from __future__ import annotations

from pathlib import Path

from hrclog.errors import LogWriteError
from hrclog.files import Fill, remedy_for, sync_folder, write_whole


def exists(path: Path) -> bool:
    """Return whether a path exists; False also if it is too long or not accessible."""
    try:
        return path.exists()
    except OSError:
        return False


def replace_atomically(path: Path, fill: Fill, *, sync_names: bool = True) -> None:
    """Let `fill` write a hidden file, sync it, and rename it to `path`: it is there whole, or not at all.

    Args:
        path: the file.
        fill: writes its bytes.
        sync_names: whether the name, too, survives a crash at once; who writes many files may call `sync_folder` once.

    Raises:
        LogWriteError: the file cannot be written.
    """
    try:
        write_whole(path, fill, durable=True)
        if sync_names:
            sync_folder(path.parent)
    except OSError as error:
        reason = f"cannot be written ({error.strerror or error})"
        raise LogWriteError(path, reason, remedy_for(error, "choose a folder that can be written")) from error
