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
    from hrclog.analyzers.comparison.compare import Comparison, compare
    from hrclog.analyzers.exporters.exporter import Exporter
    from hrclog.analyzers.exporters.save import save_table
    from hrclog.analyzers.prediction.from_logs import score
    from hrclog.analyzers.prediction.score import Score
    from hrclog.analyzers.projections.durations import durations
    from hrclog.analyzers.projections.intervals import intervals
    from hrclog.analyzers.projections.metrics import metrics
    from hrclog.analyzers.projections.overlaps import overlaps
    from hrclog.analyzers.result import Analysis
    from hrclog.analyzers.search.find import find_plan
    from hrclog.analyzers.search.replan import replanner
    from hrclog.analyzers.search.wish import Wish
    from hrclog.analyzers.synergy.estimator import Coefficient, Estimator
    from hrclog.analyzers.synergy.estimators import register_estimator
    from hrclog.analyzers.synergy.fit import Fit
    from hrclog.analyzers.synergy.observations import Observations
    from hrclog.knowledge import open_knowledge
    from hrclog.log.logs import Logs
    from hrclog.log.reader import read_events, read_logs
    from hrclog.planning.plan import Plan, make_plan, read_plan, write_plan
    from hrclog.planning.problem import Count, Problem, Task
    from hrclog.recorders.annotate import annotate
    from hrclog.recorders.importers.importer import Foreign, Importer
    from hrclog.recorders.importers.table.from_table import from_table, write_logs
    from hrclog.recorders.recorder import Recorder
    from hrclog.recorders.task_handle import TaskHandle
    from hrclog.sim.scenario import Scenario, load_scenario

_LAZY = {
    "Analysis": "hrclog.analyzers.result",
    "Coefficient": "hrclog.analyzers.synergy.estimator",
    "Comparison": "hrclog.analyzers.comparison.compare",
    "Count": "hrclog.planning.problem",
    "Estimator": "hrclog.analyzers.synergy.estimator",
    "Exporter": "hrclog.analyzers.exporters.exporter",
    "Fit": "hrclog.analyzers.synergy.fit",
    "Foreign": "hrclog.recorders.importers.importer",
    "Importer": "hrclog.recorders.importers.importer",
    "Logs": "hrclog.log.logs",
    "Observations": "hrclog.analyzers.synergy.observations",
    "Plan": "hrclog.planning.plan",
    "Problem": "hrclog.planning.problem",
    "Recorder": "hrclog.recorders.recorder",
    "Scenario": "hrclog.sim.scenario",
    "Score": "hrclog.analyzers.prediction.score",
    "Task": "hrclog.planning.problem",
    "TaskHandle": "hrclog.recorders.task_handle",
    "Wish": "hrclog.analyzers.search.wish",
    "analyze": "hrclog.analyzers.analysis",
    "annotate": "hrclog.recorders.annotate",
    "compare": "hrclog.analyzers.comparison.compare",
    "durations": "hrclog.analyzers.projections.durations",
    "find_plan": "hrclog.analyzers.search.find",
    "from_table": "hrclog.recorders.importers.table.from_table",
    "intervals": "hrclog.analyzers.projections.intervals",
    "load_scenario": "hrclog.sim.scenario",
    "make_plan": "hrclog.planning.plan",
    "metrics": "hrclog.analyzers.projections.metrics",
    "open_knowledge": "hrclog.knowledge",
    "overlaps": "hrclog.analyzers.projections.overlaps",
    "read_events": "hrclog.log.reader",
    "read_logs": "hrclog.log.reader",
    "read_plan": "hrclog.planning.plan",
    "register_estimator": "hrclog.analyzers.synergy.estimators",
    "replanner": "hrclog.analyzers.search.replan",
    "save_table": "hrclog.analyzers.exporters.save",
    "score": "hrclog.analyzers.prediction.from_logs",
    "write_logs": "hrclog.recorders.importers.table.from_table",
    "write_plan": "hrclog.planning.plan",
}

__all__ = [
    "Analysis",
    "Coefficient",
    "Comparison",
    "Count",
    "Estimator",
    "Exporter",
    "Fit",
    "Foreign",
    "HrclogError",
    "Importer",
    "Logs",
    "Observations",
    "Plan",
    "Problem",
    "Recorder",
    "Scenario",
    "Score",
    "Task",
    "TaskHandle",
    "Wish",
    "__version__",
    "analyze",
    "annotate",
    "compare",
    "durations",
    "find_plan",
    "from_table",
    "intervals",
    "load_scenario",
    "make_plan",
    "metrics",
    "open_knowledge",
    "overlaps",
    "read_events",
    "read_logs",
    "read_plan",
    "register_estimator",
    "replanner",
    "save_table",
    "score",
    "write_logs",
    "write_plan",
]


def __getattr__(name: str) -> Any:  # noqa: ANN401 - whatever the room defines
    """Import a public name from the package that defines it."""
    if name not in _LAZY:
        raise AttributeError(f"module 'hrclog' has no attribute {name!r}")
    value = getattr(importlib.import_module(_LAZY[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
