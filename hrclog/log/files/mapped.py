"""Files that are mapped into memory instead of read: of a large bag, only the pages that are looked at are loaded."""

from __future__ import annotations

import mmap
from pathlib import Path
from typing import cast


class _MappedFile(mmap.mmap):
    """A mapping with those methods of bytes that readers of logs use."""

    def startswith(self, prefix: bytes, begin: int = 0) -> bool:
        return self[begin : begin + len(prefix)] == prefix

    def endswith(self, suffix: bytes) -> bool:
        return len(self) >= len(suffix) and self[len(self) - len(suffix) :] == suffix


def map_file(path: Path) -> bytes:
    """Return what a file holds, to be read like bytes; a file that cannot be mapped is read.

    Raises:
        OSError: it cannot be opened.
    """
    with path.open("rb", buffering=0) as stream:
        try:
            return cast("bytes", _MappedFile(stream.fileno(), 0, access=mmap.ACCESS_READ))
        except (ValueError, OSError):  # it is empty, or lies where nothing can be mapped
            return stream.read()
