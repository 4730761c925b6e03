"""What is excluded: events of mistaken entries, which count as if they had never been recorded.

The last word on a run, an execution or a span holds. An execution is excluded where its run is, where it is itself,
or where a part of it lies in an excluded span; so are its steps. Nothing is removed from a log: readers leave it out.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import polars as pl

from hrclog.diagnostic import Diagnostic
from hrclog.events import TASK_KINDS, AnnotationAdded
from hrclog.log.annotations.said import Said, Verdict, said_in
from hrclog.log.annotations.targets import Target
from hrclog.log.remarks import said_among
from hrclog.wording import agree, counted

_MOST_SHOWN: Final = 3
_KEY: Final = ("run_id", "execution_id")

Key = tuple[str, str]
"""Run and execution."""


@dataclass(frozen=True, slots=True)
class Exclusion:
    """What somebody says is not to count, and how much of what was read that is.

    Attributes:
        run_id: of the run.
        path: of the annotation.
        verdict: excluded, or not_learnt.
        target: what it is about.
        reason: why.
        author: who says so.
        at_ns: when it was said, ns since the epoch.
        executions: those it means, by id with agent and task.
    """

    run_id: str
    path: str
    verdict: Verdict
    target: Target
    reason: str
    author: str
    at_ns: int
    executions: Mapping[str, tuple[str, str]]

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {
            "run_id": self.run_id,
            "verdict": str(self.verdict),
            **self.target.to_json(),
            "executions": list(self.executions),
            "reason": self.reason,
            "author": self.author,
            "at_ns": self.at_ns,
        }


@dataclass(frozen=True, slots=True)
class Judged:
    """Events that count, those that are excluded, and what was said."""

    events: pl.DataFrame
    excluded: pl.DataFrame
    exclusions: list[Exclusion]


def judged(events: pl.DataFrame) -> Judged:
    """Tell the events that count from those that are excluded.

    Args:
        events: an events frame.
    """
    exclusions = exclusions_in(events)
    if not exclusions:
        return Judged(events, events.clear(), [])
    excluding = [entry for entry in exclusions if entry.verdict is Verdict.EXCLUDED]
    runs = sorted({entry.run_id for entry in excluding if entry.target.is_run})
    keys = _frame({(entry.run_id, execution) for entry in excluding for execution in entry.executions})
    marked = events.join(keys, on=_KEY, how="left", maintain_order="left")
    is_out = pl.col("run_id").is_in(runs) | (pl.col("is_meant").fill_null(value=False) & (pl.col("execution_id") != ""))
    kept, excluded = marked.filter(~is_out), marked.filter(is_out)
    return Judged(kept.drop("is_meant"), excluded.drop("is_meant"), exclusions)


def not_learnt(events: pl.DataFrame) -> pl.DataFrame:
    """Return run_id and execution_id of the executions from which nothing is to be learnt."""
    entries = [entry for entry in exclusions_in(events) if entry.verdict is Verdict.NOT_LEARNT]
    return _frame({(entry.run_id, execution) for entry in entries for execution in entry.executions}).select(_KEY)


def exclusions_in(events: pl.DataFrame) -> list[Exclusion]:
    """Return what is excluded or not learnt from, in the order of runs and of time."""
    if not _may_hold_words(events):
        return []
    last = _last_words(events)
    if not last:
        return []
    runs = {run for run, _ in last}
    by_run = {str(run): part for (run,), part in _executions(events, runs).partition_by("run_id", as_dict=True).items()}
    exclusions = []
    for (run, target), (said, path) in last.items():
        verdict = said.judgements[target]
        if verdict is not Verdict.INCLUDED:
            meant = _meant(by_run.get(run), target)
            exclusions.append(Exclusion(run, path, verdict, target, said.reason, said.author, said.at_ns, meant))
    return sorted(exclusions, key=lambda entry: (entry.run_id, entry.at_ns, str(entry.target)))


def excluded_runs(files: Iterable[pl.DataFrame]) -> list[Exclusion]:
    """Return what is said of whole runs that are excluded, by annotations beside any of their files."""
    telling = [said_among(events) for events in files if _may_hold_words(events)]
    exclusions = exclusions_in(pl.concat(telling)) if telling else []
    return [entry for entry in exclusions if entry.target.is_run and entry.verdict is Verdict.EXCLUDED]


def executions_meant(events: pl.DataFrame, targets: Mapping[str, Target]) -> dict[str, dict[str, tuple[str, str]]]:
    """Return by run the executions that a target there means, by id with agent and task; no run of which it is none.

    Args:
        events: an events frame.
        targets: by run.
    """
    parts = _executions(events, targets).partition_by("run_id", as_dict=True)
    meant = {str(run): _meant(part, targets[str(run)]) for (run,), part in parts.items()}
    return {run: executions for run, executions in meant.items() if executions}


def exclusion_diagnostics(exclusions: Iterable[Exclusion]) -> list[Diagnostic]:
    """Say once what is excluded, and what somebody means that is not there."""
    entries = list(exclusions)
    unmatched = [
        Diagnostic(
            "exclusion_unmatched",
            f"an annotation has {_target_text(entry.target)} {_VERDICTS[entry.verdict]}, of which there is nothing",
            entry.path,
            entry.run_id,
        )
        for entry in entries
        if not entry.executions and not entry.target.is_run
    ]
    texts = [_summary(entries, verdict) for verdict in (Verdict.EXCLUDED, Verdict.NOT_LEARNT)]
    found = "; ".join(filter(None, texts))
    return [*([Diagnostic("excluded", f"as annotations say, {found}")] if found else []), *unmatched]


_VERDICTS: Final = {Verdict.EXCLUDED: "excluded", Verdict.NOT_LEARNT: "not learnt from"}


def _may_hold_words(events: pl.DataFrame) -> bool:
    """Return whether anything may have been said; a column by itself costs little, and most logs have no annotation."""
    return bool((events["kind"] == AnnotationAdded.kind).any())


def _summary(entries: list[Exclusion], verdict: Verdict) -> str:
    of_verdict = [entry for entry in entries if entry.verdict is verdict]
    runs = {entry.run_id for entry in of_verdict if entry.target.is_run}
    executions = {
        (entry.run_id, execution): (entry, named)
        for entry in of_verdict
        if entry.run_id not in runs
        for execution, named in entry.executions.items()
    }
    parts = [counted(len(runs), "run")] if runs else []
    parts += [counted(len(executions), "execution")] if executions else []
    if not parts:
        return ""
    reasons = Counter(entry.reason or "no reason given" for entry in of_verdict)
    shown = [reason for reason, _ in sorted(reasons.items())[:_MOST_SHOWN]]
    more = [f"{len(reasons) - _MOST_SHOWN} more"] if len(reasons) > _MOST_SHOWN else []
    verb = agree(len(runs) + len(executions), "is", "are")
    return f"{' and '.join(parts)} {verb} {_VERDICTS[verdict]} ({'; '.join([*shown, *more])})"


def _target_text(target: Target) -> str:
    if target.is_run:
        return "the run"
    return f"execution {target.execution_id!r}" if target.execution_id else "a span"


def _last_words(events: pl.DataFrame) -> dict[tuple[str, Target], tuple[Said, str]]:
    """Return by run and target what was said last of it, and where."""
    rows = said_among(events).select("run_id", "details", "reason", "path").iter_rows()
    words = [(run, said_in(details, reason), path) for run, details, reason, path in rows]
    last: dict[tuple[str, Target], tuple[Said, str]] = {}
    for run, said, path in sorted(words, key=lambda word: word[1].at_ns):
        for target in said.judgements:
            last[run, target] = (said, path)
    return last


def _executions(events: pl.DataFrame, runs: Iterable[str]) -> pl.DataFrame:
    """Return the executions of runs: when they began, and ended if they did, and whose steps they are."""
    of_runs = events.filter(
        pl.col("run_id").is_in(sorted(runs)) & pl.col("kind").is_in(TASK_KINDS) & (pl.col("execution_id") != "")
    )
    time = pl.col("time_ns")
    return of_runs.group_by(_KEY).agg(
        pl.col("agent", "task", "parent_execution_id").first(),
        time.filter(pl.col("kind") != "task_dispatched").min().alias("start_ns"),
        time.filter(pl.col("kind") == "task_ended").max().alias("end_ns"),
    )


def _meant(executions: pl.DataFrame | None, target: Target) -> dict[str, tuple[str, str]]:
    """Return the executions that a target means, by id with agent and task, and their steps."""
    if executions is None:
        return {}
    if target.is_run:
        chosen = executions
    elif target.execution_id:
        chosen = executions.filter(pl.col("execution_id") == target.execution_id)
    else:
        chosen = executions.filter(_touches(target))
    ids = set(chosen["execution_id"])
    while True:
        steps = executions.filter(
            pl.col("parent_execution_id").is_in(sorted(ids)) & ~pl.col("execution_id").is_in(sorted(ids))
        )
        if steps.is_empty():
            break
        ids |= set(steps["execution_id"])
    named = executions.filter(pl.col("execution_id").is_in(sorted(ids))).sort("execution_id")
    return {row[0]: (row[1], row[2]) for row in named.select("execution_id", "agent", "task").iter_rows()}


def _touches(target: Target) -> pl.Expr:
    """Return which executions have a part in a span; one that has not ended goes on."""
    starts_before = pl.lit(value=True) if target.to_ns is None else pl.col("start_ns") < target.to_ns
    if target.from_ns is None:
        return starts_before & pl.col("start_ns").is_not_null()
    ends_after = pl.col("end_ns").is_null() | (pl.col("end_ns") > target.from_ns)
    return starts_before & (ends_after | (pl.col("start_ns") >= target.from_ns)).fill_null(value=False)


def _frame(keys: set[Key]) -> pl.DataFrame:
    rows = [(run, execution, True) for run, execution in sorted(keys)]
    schema = {"run_id": pl.String, "execution_id": pl.String, "is_meant": pl.Boolean}
    return pl.DataFrame(rows, schema=schema, orient="row")
