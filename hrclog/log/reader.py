"""Read event logs of any state - finished, unfinished, damaged, out of order - into one events frame.

Payload times come first; ties are broken by `seq`. Nothing is repaired silently: what was lost or doubtful is a
diagnostic, and one bad file never hides the others.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import polars as pl

from hrclog.diagnostic import Diagnostic
from hrclog.errors import LogReadError, NoLogError
from hrclog.log.annotations.beside import with_annotations
from hrclog.log.annotations.exclusions import Exclusion, Judged, excluded_runs, exclusion_diagnostics, judged
from hrclog.log.bags.folder import is_bag
from hrclog.log.checks import check_events, check_given_numbers, usable, without_copies
from hrclog.log.clocks.correction import NO_CLOCKS, Clocks, on_one_clock
from hrclog.log.files.discover import Discovery, discover
from hrclog.log.files.system import exists
from hrclog.log.losses import annotated_losses
from hrclog.log.messages.channels import EVENTS_TOPIC
from hrclog.log.messages.decode import EVENT_COLUMNS
from hrclog.log.messages.failures import Complain
from hrclog.log.messages.message import EVENTS
from hrclog.log.messages.recorded_scene import RecordedScene, merged, recorded_scene
from hrclog.log.messages.signals import SIGNAL_COLUMNS, merged_samples
from hrclog.log.never_set import with_left_out_zero, with_numbers, without_unset
from hrclog.log.parts import complaints, decode_bag, decode_file
from hrclog.log.runs.names import Joined, joined_splits, name_runs, named
from hrclog.log.runs.tags import run_tags
from hrclog.log.runs.where import ALL_RUNS, Condition, Where, conditions, matching_runs
from hrclog.log.writing.journal import journal_path
from hrclog.wording import counted

ORDER: Final = ("run_id", "time_ns", "seq", "kind", "execution_id")
"""The total order of events."""

_MOST_TOPICS: Final = 20  # that a message lists
_NO_EVENTS: Final = EVENTS.to_frame()
_NO_TOPICS: Final = "it has no topics"
_LONE: Final = "annotations without the log that they are of, which was beside them: they were not read"


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


def read_logs(
    arguments: Iterable[str | Path],
    *,
    signals: bool = False,
    on_file: Callable[[Path], None] = lambda _: None,
    clocks: Clocks = NO_CLOCKS,
    where: Where = ALL_RUNS,
    with_excluded: bool = False,
) -> Logs:
    """Read logs, folders and globs.

    Args:
        arguments: what to read.
        signals: also read scalar and joint signals, and what was recorded of the scene.
        on_file: called after each file, for progress.
        clocks: by agent, how far its clock is ahead, in ns or as a text (+3600s); that is taken off its times.
        where: which runs, by their tags: texts such as participant=P01 or condition!=pilot, or values by key.
        with_excluded: also what annotations exclude, among all else.

    Raises:
        LogReadError: nothing matched, or no file could be read at all.
        HrclogError: no event names an agent of `clocks`, or an offset is none; or no run is as `where` says.
    """
    discovery = _discover(_listed(arguments))
    parts, failures = _read_all(discovery, on_file, signals=signals)
    if len(failures) == 1 and not parts:
        raise failures[0]
    if not parts:
        failure_text = f"{len(failures)} files that cannot be read, the first: {failures[0]}"
        raise LogReadError(failures[0].path.parent, failure_text, "at least one log") from failures[0]
    counting = _without_foreign(parts, discovery.named)
    logs = _combine(counting, failures, clocks, conditions(where), with_excluded=with_excluded)
    notes = [Diagnostic("unread_logs", text, str(path)) for path, text in discovery.unread]
    notes += [Diagnostic("annotation_unmatched", _LONE, str(path)) for path in discovery.lone_annotations]
    return replace(logs, diagnostics=[*logs.diagnostics, *notes])


def read_events(
    paths: str | Path | Iterable[str | Path], *, clocks: Clocks = NO_CLOCKS, where: Where = ALL_RUNS
) -> pl.DataFrame:
    """Read the events of logs, folders and globs, ordered by (run_id, time_ns, seq).

    Args:
        paths: what to read.
        clocks: by agent, how far its clock is ahead, in ns or as a text (+3600s); that is taken off its times.
        where: which runs, by their tags: texts such as participant=P01 or condition!=pilot, or values by key.

    Returns:
        One row per event with the columns of `hrclog.log.messages.message.EVENTS`; instants in ns on the recorder's
        clock, texts "" and numbers null where unset.

    Raises:
        LogReadError: nothing matched, or a file cannot be read; `read_logs` reads past such files.
        HrclogError: no event names an agent of `clocks`, or an offset is none; or no run is as `where` says.
    """
    parts, failures = _read_all(_discover(_listed(paths)))
    if failures:
        raise failures[0]
    return _combine(parts, [], clocks, conditions(where)).events


def _listed(arguments: object) -> list[str | Path]:
    """Return paths as a list; a user may give anything.

    Raises:
        LogReadError: it is no path and no list of them.
    """
    entries = [arguments] if isinstance(arguments, str | Path) or not isinstance(arguments, Iterable) else arguments
    paths: list[str | Path] = []
    for entry in entries:
        if not isinstance(entry, str | Path):
            shown = f"{entry!r} " if entry is None or isinstance(entry, int | float) else "something "
            raise LogReadError(
                "logs", f"{shown}of type {type(entry).__name__}", "paths, folders or globs of .mcap files"
            )
        paths.append(entry)
    return paths


def _discover(arguments: list[str | Path]) -> Discovery:
    """Find the logs.

    Raises:
        LogReadError: there is none.
    """
    discovery = discover(arguments)
    if not discovery.logs and not discovery.unreadable:
        names = ", ".join(map(str, arguments)) or "no argument"
        remedy = "; ".join(f"{path}: {text}" for path, text in discovery.unread)
        raise NoLogError(names, "no log", "paths, folders or globs of .mcap files", remedy)
    return discovery


def _read_all(
    discovery: Discovery, on_file: Callable[[Path], None] = lambda _: None, *, signals: bool = False
) -> tuple[list[Logs], list[LogReadError]]:
    parts: list[Logs] = []
    failures = [
        LogReadError(folder, f"a folder that cannot be opened ({reason})", "one to be searched for logs")
        for folder, reason in discovery.unreadable
    ]
    for path in discovery.logs:
        try:
            parts.append(read_annotated(path, signals=signals))
        except LogReadError as error:
            failures.append(error)
        on_file(path)
    return parts, failures


def _without_foreign(parts: list[Logs], named: frozenset[Path]) -> list[Logs]:
    """Make mere notes of recordings of another system that lie in a folder beside logs with events: none is lost."""
    if not any(part.events.height for part in parts):
        return parts
    return [
        replace(part, diagnostics=[_as_note(finding) for finding in part.diagnostics])
        if part.is_foreign and named.isdisjoint(part.paths)
        else part
        for part in parts
    ]


def tells_of_another_system(finding: Diagnostic) -> bool:
    """Return whether a finding tells of a recording with topics, of which none is of events."""
    is_about_topics = finding.code in ("no_events", "not_imported") and _NO_TOPICS not in finding.message
    return is_about_topics and f"{EVENTS_TOPIC} (" not in finding.message


def _as_note(finding: Diagnostic) -> Diagnostic:
    return replace(finding, code="not_imported") if finding.code == "no_events" else finding


def read_annotated(path: Path, *, signals: bool = False) -> Logs:
    """Read one file or bag as `read_log` does, and behind its events the annotations beside it.

    Raises:
        LogReadError: it is missing, cannot be opened, or is no event log at all.
    """
    log = read_log(path, signals=signals)
    diagnostics = list(log.diagnostics)
    return replace(log, events=with_annotations(log.events, path, diagnostics), diagnostics=diagnostics)


def read_log(path: Path, *, signals: bool = False) -> Logs:
    """Read one file or bag, without annotations beside it.

    Its events are in the order of writing, and `seq` is null where the writer gave none.

    Raises:
        LogReadError: it is missing, cannot be opened, or is no event log at all.
    """
    diagnostics: list[Diagnostic] = []
    complain = complaints(path, diagnostics)
    if not exists(path):
        if os.path.islink(path):  # noqa: PTH114 - that of a path fails on names that are too long
            raise LogReadError(path, f"a link to {path.readlink()}, which is not there", "an event log")
        journal = journal_path(path)
        remedy = f"its recorder was killed: hrclog recover {journal}" if exists(journal) else "check the path"
        raise LogReadError(path, "nothing", "an event log", remedy)
    if is_bag(path):
        decoded = decode_bag(path, diagnostics, signals=signals)
    else:
        decoded = {path: decode_file(path, complain, signals=signals)}
    pieces = [(part, _stacked(content.events, EVENT_COLUMNS)) for part, content in decoded.items()]
    frames, texts = name_runs(pieces, path)
    for text in texts:
        complain("no_run_id", text, None)
    events = _stacked(frames, EVENT_COLUMNS).with_columns(pl.lit(str(path)).alias("path"))
    is_foreign = False
    if events.is_empty() and not any(diagnostic.severity == "error" for diagnostic in diagnostics):
        topics = sum((content.topics for content in decoded.values()), Counter[tuple[str, str]]())
        is_foreign = bool(topics) and not any(topic.endswith(EVENTS_TOPIC) for topic, _ in topics)
        complain("no_events", f"the log carries no task events; {_topics_text(topics)}", None)
    is_nameless = any(diagnostic.code == "no_run_id" for diagnostic in diagnostics)
    run_ids = events["run_id"].unique().to_list()
    if run_ids and not is_nameless:
        _report_foreign_samples([frame for content in decoded.values() for frame in content.signals], run_ids, complain)
    samples: list[pl.DataFrame] = []
    scenes: list[RecordedScene] = []
    for content, own_events in zip(decoded.values(), frames, strict=True):
        run_id = _only_run(own_events) or _only_run(events)
        samples.append(_samples(content.signals, run_id, is_nameless=is_nameless))
        scenes.append(recorded_scene(content.scene, run_id, lambda text: complain("invalid_scene", text, None)))
    scene = scenes[0] if len(scenes) == 1 else merged(scenes)
    return Logs(events, _stacked(samples, SIGNAL_COLUMNS), diagnostics, [path], scene, is_foreign=is_foreign)


def _stacked(frames: list[pl.DataFrame], schema: pl.Schema) -> pl.DataFrame:
    if len(frames) == 1:
        return frames[0]
    return pl.concat(frames) if frames else schema.to_frame()


def _samples(frames: list[pl.DataFrame], only_run: str | None, *, is_nameless: bool) -> pl.DataFrame:
    """Return the samples of a file; those that name no run belong to its only one."""
    samples = pl.concat(frames) if frames else pl.DataFrame(schema=SIGNAL_COLUMNS)
    if only_run is None or _runs_of(frames) <= {only_run}:
        return samples
    named = pl.lit(value=not is_nameless) & (pl.col("run_id") != "")
    return samples.with_columns(pl.when(named).then("run_id").otherwise(pl.lit(only_run)).alias("run_id"))


def _runs_of(frames: list[pl.DataFrame]) -> set[str]:
    """Return the runs that frames name; all samples of a frame are of one channel, which names one."""
    return {str(frame["run_id"][0]) for frame in frames if frame.height}


def _report_foreign_samples(frames: list[pl.DataFrame], run_ids: list[str], complain: Complain) -> None:
    """Report samples that name a run of which the file has no event; they stay that run's."""
    for run_id in sorted(_runs_of(frames) - {"", *run_ids}):
        samples = pl.concat(frame for frame in frames if frame.height and frame["run_id"][0] == run_id)
        whose = f"of run {run_id!r}, the first of {samples['name'][0]!r}"
        expected = f"expected run {run_ids[0]!r}" if len(run_ids) == 1 else f"expected one of {len(run_ids)} runs"
        text = counted(samples.height, "sample is", "samples are")
        complain("foreign_records", f"{text} {whose}, of which the file has no event; {expected}", None)


def _only_run(events: pl.DataFrame) -> str | None:
    return str(events["run_id"][0]) if events["run_id"].n_unique() == 1 else None


def _topics_text(topics: Mapping[tuple[str, str], int]) -> str:
    listed = [
        f"{topic} ({kind or 'no type'}, {counted(count, 'message')})"
        for (topic, kind), count in sorted(topics.items())[:_MOST_TOPICS]
    ]
    if not listed:
        return _NO_TOPICS
    others = len(topics) - len(listed)
    return f"it has {', '.join(listed)}{f' and {others} more topics' if others else ''}"


def _join_splits(parts: list[Logs]) -> list[Logs]:
    """Make one run of files that a recording without run ids was split into."""
    nameless = {
        part.paths[0]: part.events
        for part in parts
        if any(diagnostic.code == "no_run_id" for diagnostic in part.diagnostics) and not is_bag(part.paths[0])
    }
    joined = joined_splits(nameless)
    return [_renamed(part, joined[part.paths[0]]) if part.paths[0] in joined else part for part in parts]


def _renamed(log: Logs, joined: Joined) -> Logs:
    names = joined.names
    scene = RecordedScene(
        {names.get(run, run): part for run, part in log.scene.scenes.items()},
        {(names.get(run, run), agent): text for (run, agent), text in log.scene.descriptions.items()},
        named(log.scene.poses, names),
    )
    diagnostics = [diagnostic for diagnostic in log.diagnostics if diagnostic.code != "no_run_id"]
    if joined.text:
        diagnostics.append(Diagnostic("no_run_id", joined.text, str(log.paths[0])))
    return Logs(named(log.events, names), named(log.signals, names), diagnostics, log.paths, scene)


def only_runs(logs: Logs, where: Where) -> Logs:
    """Return what logs hold of some runs; what is known of files without such a run is left out too.

    Args:
        logs: what was read.
        where: which runs, as of `read_logs`.

    Raises:
        HrclogError: no run is so.
    """
    wanted = conditions(where)
    return _selected([logs], wanted)[0] if wanted else logs


def _selected(parts: list[Logs], wanted: tuple[Condition, ...]) -> list[Logs]:
    events = pl.concat([part.events.select("run_id", "kind", "seq", "details") for part in parts])
    chosen = set(matching_runs(events["run_id"].unique().sort(), run_tags(events), wanted))
    return [_of_runs(part, chosen) for part in parts]


def _without_excluded_runs(parts: list[Logs]) -> tuple[list[Logs], list[Exclusion]]:
    """Leave out runs that annotations exclude, and what is doubtful about their files; return what these say too."""
    # of all parts together: the last word on a run may stand beside any of its files
    exclusions = excluded_runs(part.events for part in parts)
    if not exclusions:
        return parts, []
    runs = {run for part in parts for run in part.events["run_id"].unique()}
    kept = runs - {entry.run_id for entry in exclusions}
    return [_of_runs(part, kept) for part in parts], exclusions


def _of_runs(part: Logs, chosen: set[str]) -> Logs:
    is_chosen = pl.col("run_id").is_in(sorted(chosen))
    events = part.events.filter(is_chosen)
    left_out = set(part.events["path"].unique()) - set(events["path"].unique())
    diagnostics = [
        finding
        for finding in part.diagnostics
        if finding.path not in left_out and (not finding.run_id or finding.run_id in chosen)
    ]
    paths = [path for path in part.paths if str(path) not in left_out]
    return Logs(events, part.signals.filter(is_chosen), diagnostics, paths, part.scene.only(chosen))


def _combine(
    parts: list[Logs],
    failures: list[LogReadError],
    clocks: Clocks,
    wanted: tuple[Condition, ...],
    *,
    with_excluded: bool = False,
) -> Logs:
    # the result does not depend on the order of the arguments
    parts = _join_splits(sorted(parts, key=lambda part: part.paths))
    counting, exclusions = _without_excluded_runs(parts)
    parts = parts if with_excluded else counting
    if wanted:
        parts = _selected(parts, wanted)
    diagnostics = [diagnostic for part in parts for diagnostic in part.diagnostics]
    diagnostics += [
        Diagnostic("unreadable_file", failure.reason, str(failure.path))
        for failure in sorted(failures, key=lambda failure: failure.path)
    ]
    events, copies = without_copies(pl.concat([part.events for part in parts]))
    events, unset = without_unset(events.select(EVENTS.names()))
    events = with_left_out_zero(events)
    misnumbered = check_given_numbers(events)
    events, unnumbered = with_numbers(events)
    events, corrections = on_one_clock(events, clocks)
    events = events.sort(ORDER, maintain_order=True)
    losses = annotated_losses(events, diagnostics)
    diagnostics += [*losses, *copies, *unset, *misnumbered, *unnumbered, *corrections, *check_events(events)]
    events = usable(events)
    verdict = Judged(events, events.clear(), []) if with_excluded else judged(events)
    exclusions = [] if with_excluded else [*exclusions, *verdict.exclusions]
    diagnostics += exclusion_diagnostics(exclusions)
    samples = merged_samples([part.signals for part in parts])
    paths = [path for part in parts for path in part.paths]
    scene = merged(part.scene for part in parts)
    return Logs(verdict.events, samples, diagnostics, paths, scene, verdict.excluded, exclusions)
