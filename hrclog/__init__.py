"""Event-sourced log processing for human-robot collaboration.

The public face: names are imported from their rooms when they are first used, so that `import hrclog` is cheap.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from hrclog._version import __version__
from hrclog.errors import HrclogError

if TYPE_CHECKING:
    from hrclog.analyzers.analysis import analyze
    from hrclog.analyzers.projections.durations import durations
    from hrclog.analyzers.projections.intervals import intervals
    from hrclog.analyzers.projections.metrics import metrics
    from hrclog.analyzers.projections.overlaps import overlaps
    from hrclog.analyzers.result import Analysis
    from hrclog.analyzers.search.find import find_plan
    from hrclog.analyzers.search.replan import replanner
    from hrclog.analyzers.search.wish import Wish
    from hrclog.knowledge import open_knowledge
    from hrclog.log.reader import Logs, read_events, read_logs
    from hrclog.recorders.recorder import Recorder, TaskHandle

_LAZY = {
    "Analysis": "hrclog.analyzers.result",
    "Logs": "hrclog.log.reader",
    "Recorder": "hrclog.recorders.recorder",
    "TaskHandle": "hrclog.recorders.recorder",
    "Wish": "hrclog.analyzers.search.wish",
    "analyze": "hrclog.analyzers.analysis",
    "durations": "hrclog.analyzers.projections.durations",
    "find_plan": "hrclog.analyzers.search.find",
    "intervals": "hrclog.analyzers.projections.intervals",
    "metrics": "hrclog.analyzers.projections.metrics",
    "open_knowledge": "hrclog.knowledge",
    "overlaps": "hrclog.analyzers.projections.overlaps",
    "read_events": "hrclog.log.reader",
    "read_logs": "hrclog.log.reader",
    "replanner": "hrclog.analyzers.search.replan",
}

__all__ = [
    "Analysis",
    "HrclogError",
    "Logs",
    "Recorder",
    "TaskHandle",
    "Wish",
    "__version__",
    "analyze",
    "durations",
    "find_plan",
    "intervals",
    "metrics",
    "open_knowledge",
    "overlaps",
    "read_events",
    "read_logs",
    "replanner",
]


def __getattr__(name: str) -> Any:  # noqa: ANN401 - whatever the room defines
    """Import a public name from its room."""
    if name not in _LAZY:
        raise AttributeError(f"module 'hrclog' has no attribute {name!r}")
    value = getattr(importlib.import_module(_LAZY[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
