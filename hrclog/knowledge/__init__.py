"""What was learnt from runs, kept where planners find it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hrclog.knowledge.base import KnowledgeBase


def open_knowledge(where: str | Path, *, create: bool = False, wait_s: float = 10.0) -> KnowledgeBase:
    """Open a knowledge base.

    Args:
        where: a file (kb.sqlite), sqlite:///FILE or postgresql://USER@HOST/DATABASE.
        create: make an empty one where nothing is.
        wait_s: how long to wait while another process writes, in seconds.

    Raises:
        KnowledgeError: it cannot be reached, or is something else.
    """
    from hrclog.knowledge.base import KnowledgeBase

    return KnowledgeBase(where, create=create, wait_s=wait_s)
