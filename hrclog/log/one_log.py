"""Read one file or bag."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

import polars as pl

from hrclog.diagnostic import Diagnostic
from hrclog.errors import LogReadError
from hrclog.log.annotations.beside import with_annotations
from hrclog.log.bags.folder import is_bag
from hrclog.log.files.system import exists
from hrclog.log.logs import Logs
from hrclog.log.messages.channels import EVENTS_TOPIC
from hrclog.log.messages.decode import EVENT_COLUMNS
from hrclog.log.messages.failures import Complain
from hrclog.log.messages.recorded_scene import RecordedScene, merged, recorded_scene
from hrclog.log.messages.signals import SIGNAL_COLUMNS
from hrclog.log.parts import complaints, decode_bag, decode_file
from hrclog.log.runs.names import name_runs
from hrclog.log.writing.journal import journal_path
from hrclog.wording import counted

_MOST_TOPICS: Final = 20  # that a message lists
_NO_TOPICS: Final = "it has no topics"


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
        if os.path.islink(path):  # noqa: PTH114 - Path.is_symlink raises where a name is too long
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
