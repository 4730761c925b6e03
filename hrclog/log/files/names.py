"""What names of files say: which are taken for logs, and which for journals."""

from __future__ import annotations

from typing import Final

COMPRESSIONS: Final = (".zstd", ".zst", ".gz")
BAG_METADATA: Final = "metadata.yaml"
ANNOTATIONS_SUFFIX: Final = ".annotations.mcap"
"""Ends the name of a file of annotations, which is read with the log beside it, and is none itself."""

_JOURNAL_ENDING: Final = ".partial"
_LOG_ENDINGS: Final = (".mcap", ".mcap.partial", ".db3", ".bag", ".bag.active")


def plain_name(name: str) -> str:
    """Return the name of a file before it was compressed."""
    return next((name.removesuffix(ending) for ending in COMPRESSIONS if name.endswith(ending)), name)


def is_journal_name(name: str) -> bool:
    """Return whether a file of that name is a journal, perhaps compressed."""
    return plain_name(name).endswith(_JOURNAL_ENDING)


def is_annotations_name(name: str) -> bool:
    """Return whether a file of that name holds annotations of the log beside it."""
    return plain_name(name).endswith(ANNOTATIONS_SUFFIX)


def is_log_name(name: str) -> bool:
    """Return whether a folder's file of that name is taken for a log, or a part of a bag."""
    if name.startswith("._") or is_annotations_name(name):  # the former is what macOS leaves beside copies
        return False
    return plain_name(name.lower()).endswith(_LOG_ENDINGS)  # RUN.MCAP too, as other systems write names
