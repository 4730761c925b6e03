"""--on-run-end: a knowledge base that takes in each run as it ends."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final, Self

import click

from hrclog.cli.common import EXIT_DATA_LOST, EXIT_FINE, echo, tell
from hrclog.errors import HrclogError

if TYPE_CHECKING:
    from hrclog.knowledge.base import KnowledgeBase

WAIT_S: Final = 5.0
"""How long a run that ended waits for another writer."""

on_run_end_option = click.option(
    "--on-run-end",
    "knowledge",
    metavar="KB",
    help="Knowledge base that takes each run in as it ends; its statistics follow at once.",
)


class Following:
    """A knowledge base that is told of runs as they end; whatever becomes of it, logs are kept.

    Args:
        where: the knowledge base; None for none.
    """

    def __init__(self, where: str | None) -> None:
        self._where = where
        self._kb: KnowledgeBase | None = None
        self._behind = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._kb:
            self._kb.close()

    def take(self, logs: Sequence[Path]) -> None:
        """Take in the runs of logs, and bring the statistics up to date; after a failure nothing is tried again."""
        if self._where is None or self._behind:
            return
        from hrclog.analyzers.learning.ingest import ingest_logs, update_statistics
        from hrclog.knowledge import open_knowledge

        try:
            self._kb = self._kb or open_knowledge(self._where, create=True, wait_s=WAIT_S)
            tell(ingest_logs(self._kb, logs).diagnostics)
            update_statistics(self._kb)
        except HrclogError as error:
            self._behind = True
            echo(f"warning: the knowledge base was not updated: {error}", err=True)

    def catch_up(self, logs: str) -> int:
        """Say how to catch up where that is needed, and return the exit code.

        Args:
            logs: what is to be taken in, as arguments of a command.
        """
        if not self._behind or self._where is None:
            return EXIT_FINE
        from hrclog.knowledge.place import shown

        command = f"hrclog kb update {logs} --kb {shown(self._where)}"
        echo(f"warning: the logs are kept; catch up with: {command}", err=True)
        return EXIT_DATA_LOST
