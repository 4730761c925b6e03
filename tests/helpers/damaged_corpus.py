"""The corpus of damaged logs: files that once failed, or are of the kinds that did."""

from __future__ import annotations

import tarfile
from pathlib import Path
from typing import Final

CORPUS: Final = Path(__file__).parents[1] / "corpus"
ARCHIVE: Final = CORPUS / "damaged.tar.xz"


def damaged_files() -> dict[str, bytes]:
    """Return the files by name: those of the archive, and those that lie beside it."""
    files = {path.name: path.read_bytes() for path in sorted(CORPUS.glob("*.mcap*"))}
    with tarfile.open(ARCHIVE) as archive:
        for entry in archive.getmembers():
            stream = archive.extractfile(entry)
            if stream is not None:
                files[entry.name] = stream.read()
    return files
