"""Read ROS bags of any cell by a mapping, one recording after the other, and suggest a mapping."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from hrclog.diagnostic import Diagnostic, loses_data
from hrclog.errors import HrclogError, ImportDataError, LogReadError, MappingError
from hrclog.log.messages.channels import EVENTS_TOPIC
from hrclog.log.messages.encode import Signal
from hrclog.recorders.importers.bag_files import (
    Recording,
    Topic,
    find_recordings,
    read_recording,
    topics_text,
)
from hrclog.recorders.importers.bag_runs import Run, runs_of
from hrclog.recorders.importers.importer import Foreign, Remark
from hrclog.recorders.mapping.alignment import on_one_clock
from hrclog.recorders.mapping.engine import Engine
from hrclog.recorders.mapping.executions import SOURCE
from hrclog.recorders.mapping.mapping import Mapping, read_mapping
from hrclog.recorders.mapping.suggest import suggestion
from hrclog.wording import counted

_SUGGEST: Final = "`hrclog import bag BAG --suggest` writes a first mapping"


def read_bags(sources: Sequence[Path], mapping_path: Path | None) -> Foreign:
    """Return the runs of bags.

    Raises:
        MappingError: the mapping cannot be used: it says something wrong, or fits no bag.
        ImportDataError: there is no bag, or none can be read.
    """
    if mapping_path is None:
        raise HrclogError(f"--map: found nothing, expected a mapping file; {_SUGGEST}")
    mapping = read_mapping(mapping_path)
    reader = _Reader(mapping, {"source": SOURCE})
    for recording in _recordings(sources):
        reader.take(recording)
    reader.check()
    runs = reader.runs

    def samples(name: str) -> Sequence[Signal]:
        return runs[name].samples

    n_executions = sum(run.n_executions for run in runs.values())
    return Foreign(list(runs), lambda name: runs[name].events, n_executions, reader.diagnostics, signals=samples)


def suggest_mapping(sources: Sequence[Path]) -> Remark:
    """Return the topics of bags, and a first mapping.

    Raises:
        ImportDataError: there is no bag, or none can be read.
    """
    topics: dict[Topic, int] = {}
    definitions: dict[Topic, str] = {}
    for recording in _recordings(sources):
        content = read_recording(recording, Engine.wants_nothing, [])
        definitions |= content.definitions
        for topic, count in content.topics.items():
            topics[topic] = topics.get(topic, 0) + count
    listed = [{"topic": topic, "type": kind, "n_messages": count} for (topic, kind), count in sorted(topics.items())]
    text = suggestion(topics, definitions)
    return Remark(text, values={"topics": listed, "mapping": text})


def _recordings(sources: Sequence[Path]) -> list[Recording]:
    recordings = find_recordings(sources)
    if not recordings:
        raise ImportDataError(sources[0], "no bag in it", "a folder of bags, or a bag")
    return recordings


class _Reader:
    """Reads recordings one by one, and remembers which parts of the mapping fitted none."""

    def __init__(self, mapping: Mapping, details: dict[str, Any]) -> None:
        self.runs: dict[str, Run] = {}
        self.diagnostics: list[Diagnostic] = []
        self._mapping = mapping
        self._details = details
        self._failures: list[LogReadError] = []
        self._logs: list[Path] = []
        self._unmatched: dict[str, tuple[str, bool]] = {
            meaning.where: (meaning.pattern.text, meaning.is_optional) for meaning in mapping.meanings()[0]
        }
        self._topics: set[Topic] = set()
        self._assumed: set[str] = set()
        self._n_read = 0
        self._is_damaged = False

    def take(self, recording: Recording) -> None:
        """Read a recording; one that cannot be read hides no other."""
        path = str(recording.path)
        engine = Engine(self._mapping)
        damage: list[Diagnostic] = []
        try:
            content = read_recording(recording, engine.wants, damage, engine.definition)
        except LogReadError as error:
            self._failures.append(error)
            return
        topics = set(content.topics)
        unmatched = engine.unmatched(topics)
        if not topics:
            reason = f"no topic in it{''.join(f' ({finding.message})' for finding in damage[:1])}"
            self._failures.append(LogReadError(recording.path, reason, "a bag with messages"))
            return
        if len(unmatched) == len(engine.meanings) and any(topic == EVENTS_TOPIC for topic, _ in topics):
            self._logs.append(recording.path)
            return
        self._n_read += 1
        self._topics |= topics
        self._assumed |= content.assumed
        self._is_damaged = self._is_damaged or loses_data(damage)
        self.diagnostics += damage
        self._unmatched = {m.where: self._unmatched[m.where] for m in unmatched if m.where in self._unmatched}
        facts = [fact for received in content.messages() for fact in engine.take(received)]
        facts += engine.finish()
        content.report(recording, self.diagnostics)
        self.diagnostics += engine.diagnostics(path)
        facts, clock_remarks = on_one_clock(facts, engine.notes, path)
        runs, run_remarks = runs_of(recording.name, facts, engine.rule, self._details, path)
        self.diagnostics += [*clock_remarks, *run_remarks]
        if not runs:
            text = f"no message of the mapping says anything; the recording has {topics_text(topics)}"
            self.diagnostics.append(Diagnostic("no_events", text, path))
        for run in runs:
            self._keep(run, recording)

    def check(self) -> None:
        """Raise where nothing could be read, or a part of the mapping fits no recording; tell what was assumed."""
        if not self._n_read:
            own = [LogReadError(path, "a log of hrclog, which needs no import", "a bag") for path in self._logs]
            raise [*self._failures, *own][0]
        problems = [
            f"{where}: found no topic {text!r} in {counted(self._n_read, 'bag')}, expected one of those there"
            for where, (text, is_optional) in self._unmatched.items()
            if not is_optional
        ]
        if problems and not self._is_damaged:
            raise MappingError(self._mapping.path, [*problems, f"there are: {topics_text(self._topics)}"])
        self.diagnostics += [Diagnostic("no_events", f"{problem}; damage may have cost it") for problem in problems]
        self.diagnostics += [Diagnostic("unreadable_file", error.reason, str(error.path)) for error in self._failures]
        for path in self._logs:
            self.diagnostics.append(Diagnostic("unread_logs", "a log of hrclog, which needs no import", str(path)))
        if self._assumed:
            types = ", ".join(sorted(self._assumed))
            text = f"the bags hold no definition of {types}: read by the standard ones"
            self.diagnostics.append(Diagnostic("standard_definition", text))

    def _keep(self, run: Run, recording: Recording) -> None:
        """Keep a run under a name of its own; the same run given twice counts once."""
        twin = next((other for other in self.runs.values() if run.run_id == other.run_id), None)
        if twin is not None:
            text = f"the run {run.name!r} is there as {twin.name!r} too, and was counted once"
            self.diagnostics.append(Diagnostic("duplicate_events", text, str(recording.path)))
            if len(run.events) <= len(twin.events):
                return
            del self.runs[twin.name]  # the other is a part of it
        name = run.name
        if name in self.runs:
            name = f"{recording.name}_{name}" if name != recording.name else name
        if name in self.runs:
            name = f"{name}_{run.run_id[:8]}"
        self.runs[name] = run.called(name)
