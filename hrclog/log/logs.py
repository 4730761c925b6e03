"""What a set of logs holds, as frames."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import polars as pl

from hrclog.diagnostic import Diagnostic
from hrclog.log.annotations.exclusions import Exclusion
from hrclog.log.messages.message import EVENTS
from hrclog.log.messages.recorded_scene import RecordedScene
from hrclog.wording import counted

ORDER: Final = ("run_id", "time_ns", "seq", "kind", "execution_id")
"""The total order of events."""

_NO_EVENTS: Final = EVENTS.to_frame()


@dataclass(frozen=True, slots=True, repr=False)
class Logs:
    """What a set of files holds.

    `events` has the columns of `hrclog.log.messages.message.EVENTS` in the order `ORDER`; `signals` has
    `SIGNAL_COLUMNS`. Signals and scene are empty unless they were asked for. `excluded` are the events of executions
    that annotations exclude, and `exclusions` what these say; of whole runs that they exclude nothing else is here.
    `is_foreign` tells of a single recording that it is whole and has topics, and none of events.
    """

    events: pl.DataFrame
    signals: pl.DataFrame
    diagnostics: list[Diagnostic] = field(default_factory=list)
    paths: list[Path] = field(default_factory=list)
    scene: RecordedScene = field(default_factory=RecordedScene)
    excluded: pl.DataFrame = field(default_factory=lambda: _NO_EVENTS)
    exclusions: list[Exclusion] = field(default_factory=list)
    is_foreign: bool = False

    def __repr__(self) -> str:
        facts = [
            counted(self.events["run_id"].n_unique(), "run"),
            counted(self.events.height, "event"),
            *([f"{counted(self.signals.height, 'sample')} of signals"] if self.signals.height else []),
            *([counted(len(self.diagnostics), "diagnostic")] if self.diagnostics else []),
        ]
        return f"<hrclog.Logs: {', '.join(facts)}>"
