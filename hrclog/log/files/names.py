"""What names of files say: which are taken for logs, and which for journals."""

from __future__ import annotations

from typing import Final

COMPRESSIONS: Final = (".zstd", ".zst", ".gz")
BAG_METADATA: Final = "metadata.yaml"
_JOURNAL_ENDING: Final = ".partial"
_LOG_ENDINGS: Final = (".mcap", ".mcap.partial", ".db3", ".bag", ".bag.active")


def plain_name(name: str) -> str:
    """Return the name of a file before it was compressed."""
    return next((name.removesuffix(ending) for ending in COMPRESSIONS if name.endswith(ending)), name)


def is_journal_name(name: str) -> bool:
    """Return whether a file of that name is a journal, perhaps compressed."""
    return plain_name(name).endswith(_JOURNAL_ENDING)


def is_log_name(name: str) -> bool:
    """Return whether a folder's file of that name is taken for a log, or a part of a bag."""
    return plain_name(name).endswith(_LOG_ENDINGS) and not name.startswith("._")  # what macOS leaves beside copies
