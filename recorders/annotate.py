"""Say something of runs afterwards, beside their logs: tags, notes, and what is not to count."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import polars as pl

from hrclog.diagnostic import Diagnostic
from hrclog.errors import HrclogError, InvalidEventError
from hrclog.events import RunStarted
from hrclog.log.annotations.add import add
from hrclog.log.annotations.exclusions import Exclusion, exclusions_in, executions_meant
from hrclog.log.annotations.said import Said, Verdict
from hrclog.log.annotations.targets import RUN_WORD, Target, parse_target
from hrclog.log.logs import Logs
from hrclog.log.one_log import read_log
from hrclog.log.reader import read_logs
from hrclog.log.runs.facts import run_facts
from hrclog.log.runs.where import ALL_RUNS, Where
from hrclog.tags import checked_tags

_MOST_NAMED: Final = 10
_SHORTEST_ID: Final = 4  # characters by which an execution may be named, if no other begins so
_SPANS: Final = "expected seconds from when the run began, as timelines of reports count, or instants with a zone"
_HOW: Final = "`hrclog export LOG --table intervals -o DIR` lists them"


@dataclass(frozen=True, slots=True)
class Annotated:
    """What was annotated.

    Attributes:
        runs: names of runs by their ids.
        judged: what was said of which executions or spans, as texts, by run.
        executions: those that these mean, by run and id with agent and task.
        written: the files.
        diagnostics: what is doubtful about the logs.
    """

    runs: Mapping[str, str]
    judged: Mapping[str, list[str]]
    executions: Mapping[str, Mapping[str, tuple[str, str]]]
    written: list[Path]
    diagnostics: list[Diagnostic]


def annotate(
    paths: str | Path | Iterable[str | Path],
    tags: Mapping[str, str | float | None] | None = None,
    *,
    exclude: str | Iterable[str] = (),
    not_learnt: str | Iterable[str] = (),
    include: str | Iterable[str] = (),
    reason: str = "",
    author: str = "",
    runs: str | Iterable[str] = (),
    where: Where = ALL_RUNS,
) -> Annotated:
    """Say something of runs, beside their logs, which are not rewritten; what is said last holds.

    Args:
        paths: logs, folders and globs.
        tags: facts of the runs by key; None takes a tag back.
        exclude: what did not happen, as mistaken entries: `run`, the id of an execution (or how it begins), or FROM..TO
            (seconds from the run's start, or instants), which means the executions that have a part in it. One or
            several.
        not_learnt: what happened, but nothing is to be learnt from; it still disturbs others.
        include: of which of these it is taken back.
        reason: why; alone it is a note.
        author: who says it.
        runs: names or ids of the runs; without, all.
        where: which runs, by the tags that they have: texts such as participant=P01, or values by key.

    Raises:
        InvalidEventError: a tag or a target is none, nothing is said, or a reason is missing.
        HrclogError: there is no such run, execution or exclusion, or no run is as `where` says.
        LogReadError: nothing matched, no file could be read, or annotations that are there are damaged.
        LogWriteError: annotations cannot be written.
    """
    said = Said(_said_tags(tags), {}, _text("reason", reason).strip(), _text("author", author), time.time_ns())
    verdicts = {
        Verdict.EXCLUDED: _texts("exclude", exclude),
        Verdict.NOT_LEARNT: _texts("not_learnt", not_learnt),
        Verdict.INCLUDED: _texts("include", include),
    }
    _check(said, verdicts)
    logs = read_logs([paths] if isinstance(paths, str | Path) else paths, where=where, with_excluded=True)
    names = _named(logs, _texts("runs", runs))
    judgements, executions = _judgements(logs.events.filter(pl.col("run_id").is_in(list(names))), verdicts)
    if any(verdicts.values()) and not said.tags:
        names = {run: name for run, name in names.items() if judgements.get(run)}
    by_run = {run: replace(said, judgements=judgements.get(run, {})) for run in names}
    written = [path for log in logs.paths for path in _annotate(log, by_run)]
    texts = {run: [str(target) for target in targets] for run, targets in judgements.items()}
    return Annotated(names, texts, executions, written, logs.diagnostics)


def _text(name: str, value: object) -> str:
    if not isinstance(value, str):
        raise InvalidEventError(f"annotate: {name} is {value!r}, expected a text")
    return value


def _texts(name: str, value: object) -> list[str]:
    """Return one text or several as a list; a user may give anything."""
    texts = [value] if isinstance(value, str) or not isinstance(value, Iterable) else list(value)
    return [_text(name, text) for text in texts]


def _said_tags(tags: Mapping[str, str | float | None] | None) -> dict[str, str]:
    if tags is None:
        return {}
    if not isinstance(tags, Mapping):
        raise InvalidEventError(
            f"annotate: tags are {tags!r}, expected values by key, such as {{'participant': 'P01'}}"
        )
    taken_back = {key: "" for key, value in tags.items() if value is None}
    given = checked_tags({key: value for key, value in tags.items() if value is not None})
    checked_tags(dict.fromkeys(taken_back, "?"))  # their keys
    return given | taken_back


def _check(said: Said, verdicts: Mapping[Verdict, list[str]]) -> None:
    if not (said.tags or said.reason or any(verdicts.values())):
        raise InvalidEventError("annotate: found nothing to say, expected a tag, a note, or what to exclude")
    if (verdicts[Verdict.EXCLUDED] or verdicts[Verdict.NOT_LEARNT]) and not said.reason:
        raise InvalidEventError("annotate: found no reason, expected why this is not to count")
    texts = [text.strip() for entries in verdicts.values() for text in entries]
    twice = sorted({text for text in texts if texts.count(text) > 1})
    if twice:
        raise InvalidEventError(f"annotate: found {twice[0]!r} twice, expected one thing to be said of it")


def _named(logs: Logs, wanted: list[str]) -> dict[str, str]:
    """Return the names of the runs that are meant, by their ids."""
    names = {run: facts.name for run, facts in run_facts(logs.events).items()}
    if not wanted:
        return names
    for text in wanted:
        if text not in names and text not in names.values():
            raise HrclogError(f"run {text!r}: found no such run, expected one of {_listed(names.values())}")
    return {run: name for run, name in names.items() if run in wanted or name in wanted}


def _judgements(
    events: pl.DataFrame, verdicts: Mapping[Verdict, list[str]]
) -> tuple[dict[str, dict[Target, Verdict]], dict[str, dict[str, tuple[str, str]]]]:
    """Return what is said of which runs, and the executions that this means, those of whole runs aside.

    Raises:
        HrclogError: there is no such execution, no execution in a span, or no such exclusion to be taken back.
    """
    judgements: dict[str, dict[Target, Verdict]] = {}
    executions: dict[str, dict[str, tuple[str, str]]] = {}
    starts = _starts(events)
    standing = exclusions_in(events)
    for verdict, texts in verdicts.items():
        for text in texts:
            said_so = {entry.run_id: entry.target for entry in standing if str(entry.target) == text.strip()}
            targets = said_so if verdict is Verdict.INCLUDED and said_so else _targets(text, events, starts)
            meant = executions_meant(events, targets)
            if verdict is Verdict.INCLUDED:
                targets = _standing(text, targets, standing)
            else:
                targets = {run: target for run, target in targets.items() if target.is_run or run in meant}
                if not targets:
                    raise HrclogError(f"{text!r}: found no execution that has a part in this span; {_SPANS}")
            for run, target in targets.items():
                judgements.setdefault(run, {})[target] = verdict
                if not target.is_run:
                    executions.setdefault(run, {}).update(meant.get(run, {}))
    return judgements, executions


def _starts(events: pl.DataFrame) -> dict[str, int]:
    """Return when each run began."""
    times = events.select("run_id", "kind", "time_ns").sort("run_id", "time_ns")
    begins = dict(times.unique("run_id", keep="first").select("run_id", "time_ns").iter_rows())
    started = times.filter(pl.col("kind") == RunStarted.kind).unique("run_id", keep="first")
    return begins | dict(started.select("run_id", "time_ns").iter_rows())


def _targets(text: str, events: pl.DataFrame, starts: Mapping[str, int]) -> dict[str, Target]:
    """Return by run what a text means there."""
    ids = events.filter(pl.col("execution_id") != "").select("run_id", "execution_id").unique().rows()
    wanted = text.strip()
    matches = [] if wanted == RUN_WORD else sorted(key for key in ids if key[1] == wanted)
    if not matches:
        targets = {run: parse_target(text, start) for run, start in starts.items()}
        if not next((target.execution_id for target in targets.values()), ""):
            return targets
    if not matches and len(wanted) >= _SHORTEST_ID:
        matches = sorted(key for key in ids if key[1].startswith(wanted))
    if not matches:
        raise HrclogError(f"execution {wanted!r}: found none of this id, expected one that was recorded; {_HOW}")
    if len({execution for _, execution in matches}) > 1:
        listed = _listed(execution for _, execution in matches)
        raise HrclogError(f"execution {wanted!r}: found several that begin so, expected one of {listed}")
    return {run: Target(execution) for run, execution in matches}


def _standing(text: str, targets: Mapping[str, Target], standing: Iterable[Exclusion]) -> dict[str, Target]:
    """Return the targets of which something is said that can be taken back."""
    said = {(entry.run_id, entry.target) for entry in standing}
    taken_back = {run: target for run, target in targets.items() if (run, target) in said}
    if not taken_back:
        known = _listed(str(target) for _, target in said) or "nothing, for nothing is excluded"
        raise HrclogError(f"{text!r}: found no exclusion of it to take back, expected one of {known}")
    return taken_back


def _listed(texts: Iterable[str]) -> str:
    known = sorted(set(texts))
    more = f" and {len(known) - _MOST_NAMED} more" if len(known) > _MOST_NAMED else ""
    return ", ".join(map(repr, known[:_MOST_NAMED])) + more


def _annotate(log: Path, said: Mapping[str, Said]) -> list[Path]:
    part = read_log(log)
    runs = sorted(set(part.events["run_id"]) & set(said))
    is_nameless = part.events["run_id"].n_unique() == 1 and any(f.code == "no_run_id" for f in part.diagnostics)
    return [add(log, part.events, {run: said[run] for run in runs}, is_nameless=is_nameless)] if runs else []
