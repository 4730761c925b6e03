"""How a report's numbers were made: definitions, what the estimator assumes, versions, and from which events."""

from __future__ import annotations

import hashlib
import platform
from collections import Counter
from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING, Final

import polars as pl

from hrclog._version import __version__
from hrclog.analyzers.figures.text import printable
from hrclog.analyzers.synergy.estimators import ESTIMATORS
from hrclog.analyzers.synergy.outlier_methods import OUTLIER_METHODS
from hrclog.diagnostic import CODES, Severity
from hrclog.knowledge.records import in_order, versions
from hrclog.wording import counted

if TYPE_CHECKING:
    from hrclog.analyzers.result import Analysis

_SYNERGY: Final = (
    "The factor on a task's mean duration while another agent's task runs all the time: above 1 is slower. The mean is "
    "over all executions that succeeded, slow-downs included, so that of a task that others slow down an undisturbed "
    "pair lies below 1. synergy_free is relative to undisturbed work instead, where there was enough of it; the "
    "findings take it where it is known, and name no speed-ups relative to a mean."
)
_HOLM: Final = (
    "What remains after allowing for all comparisons is told by Holm's method at 5 %, with each interval taken as that "
    "of a normal log factor (of a normal factor where an end is not above 0); comparisons are not independent, and the "
    "method holds anyway."
)
_OVERLAP: Final = (
    "Executions occupy [start, end); two of different agents in one run overlap by max(0, min(ends) - max(starts)). n "
    "counts the pairs of executions that a factor was learnt from, whatever came of the other agent's. A pair of tasks "
    "that never overlapped has no factor, nor has one of which the first never succeeded; neither is ever taken for 1."
)
_DURATION: Final = "End minus start, pauses and slow-downs included: how long the task really took."
_MAKESPAN: Final = "From a run's first start to its last end; of an open execution to its last sign of life."
_PACKAGES: Final = ("numpy", "polars", "scipy", "scikit-learn")


@dataclass(frozen=True, slots=True)
class Remark:
    """A kind of diagnostic, how often it was made, and what it means."""

    severity: Severity
    code: str
    count: int
    meaning: str


def definitions(analysis: Analysis) -> tuple[tuple[str, str], ...]:
    """Return (term, meaning) of the terms that the report uses."""
    return (
        ("Synergy", _SYNERGY),
        ("Estimator", f"{analysis.estimator}: {ESTIMATORS[analysis.estimator].assumes}"),
        ("Intervals", _intervals(analysis.bootstrap)),
        ("Overlap", _OVERLAP),
        ("Success", _success(analysis.estimator)),
        ("Duration", _DURATION),
        ("Makespan", _MAKESPAN),
        ("Outliers", OUTLIER_METHODS[analysis.outliers].remark),
    )


def _intervals(draws: int) -> str:
    source = f"{counted(draws, 'draw')} of whole runs with repetition" if draws else "the estimator's own errors"
    chance = "Of intervals about no effect, one in twenty excludes 1 by chance."
    meaning = f"They are to hold the true factor 95 % of the time, and come from {source}."
    return f"{meaning} {chance} {_HOLM} Those of success rates are Wilson's."


def _success(estimator: str) -> str:
    cut_short = ESTIMATORS[estimator].counts_cut_short
    others = "are counted, and the estimator takes them as cut short" if cut_short else "are counted"
    return (
        "An execution succeeded if its end says so, and durations are of those alone. Executions that failed, timed "
        f"out, were canceled or are open {others}."
    )


def provenance(analysis: Analysis, command: str) -> tuple[tuple[str, str], ...]:
    """Return (name, value) pairs: from which events and with which versions the report was made."""
    digest = events_digest(analysis.events)
    events = f"{counted(analysis.events.height, 'event')}, SHA-256 {digest}"
    packages = ", ".join([f"Python {platform.python_version()}", *(f"{name} {version(name)}" for name in _PACKAGES)])
    command_entry = (("Command", printable(command)),) if command else ()
    return (*command_entry, ("Events", events), ("hrclog", __version__), ("Made with", packages))


def events_digest(events: pl.DataFrame) -> str:
    """Return the SHA-256 of the decoded events of all runs. It depends neither on the files nor on their order."""
    sha = hashlib.sha256()
    for run, run_version in sorted(versions(in_order(events)).items()):
        sha.update(f"{run}\n{run_version.digest}\n".encode())
    return sha.hexdigest()


def remarks(analysis: Analysis) -> tuple[Remark, ...]:
    """Return the remarks on the logs; those about lost data come first."""
    counts = Counter(diagnostic.code for diagnostic in analysis.diagnostics)
    return tuple(Remark(severity, code, counts[code], text) for code, (severity, text) in CODES.items() if counts[code])
