"""A run that is recorded, killed, torn, recovered, resumed and annotated in any order, beside a plain model of it."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import polars as pl
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from hrclog.errors import HrclogError, IllegalEventError
from hrclog.log.annotations.exclusions import not_learnt
from hrclog.log.logs import Logs
from hrclog.log.one_log import read_log
from hrclog.log.reader import read_logs
from hrclog.log.recover import recover
from hrclog.log.runs.tags import run_tags
from hrclog.log.writing.journal import journal_path
from hrclog.recorders.annotate import annotate
from hrclog.recorders.recorder import Recorder
from hrclog.recorders.segments import segments

BEGAN_NS: Final = 1_700_000_000 * 10**9
STEP_NS: Final = 10**9
REMARK: Final = "annotation_added"
TORN: Final = frozenset({"truncated", "recovered_with_losses"})
_AGENTS: Final = ("robot", "human")
_NUMBERS: Final = st.integers(0, 60)
_VERDICTS: Final = st.sampled_from(("exclude", "not_learnt"))

Row = tuple[str, str]
"""Kind and execution."""


@dataclass
class Model:
    """What the logs must give.

    Attributes:
        rows: events in the order of writing, each with the second at which it happened.
        sizes: bytes of the journal behind each of its events.
        verdicts: what stands of a whole run (""), an execution, or a span of seconds.
        tags: by key.
        is_torn: whether bytes of a journal were lost.
    """

    rows: list[tuple[Row, int]] = field(default_factory=list)
    sizes: list[int] = field(default_factory=list)
    verdicts: dict[str | tuple[int, int], str] = field(default_factory=dict)
    tags: dict[str, str] = field(default_factory=dict)
    is_torn: bool = False

    def phases(self) -> dict[str, str]:
        """Return the last event of every execution."""
        return {execution: kind for (kind, execution), _ in self.rows if execution}

    def touching(self, first: int, last: int) -> set[str]:
        """Return the executions that have a part in a span of seconds."""
        begins, ends = self._spans()
        return {
            key for key, begin in begins.items() if begin < last and (ends.get(key, last) > first or begin >= first)
        }

    def _spans(self) -> tuple[dict[str, int], dict[str, int]]:
        """Return when executions began, and when they ended."""
        begins: dict[str, int] = {}
        ends: dict[str, int] = {}
        for (kind, execution), second in self.rows:
            if kind == "task_started":
                begins[execution] = second
            elif kind == "task_ended":
                ends[execution] = second
        return begins, ends

    def meant(self, verdict: str) -> set[str]:
        """Return the executions that a verdict means."""
        begins, _ = self._spans()
        chosen: set[str] = set()
        for target, said in self.verdicts.items():
            if said != verdict:
                continue
            if isinstance(target, tuple):
                chosen |= self.touching(*target)
            else:
                chosen |= set(begins) if not target else {target} & set(begins)
        return chosen

    def counted(self) -> list[Row]:
        """Return the events that count."""
        if self.verdicts.get("") == "exclude":
            return []
        excluded = self.meant("exclude")
        return [row for row, _ in self.rows if row[1] not in excluded]


class RecordingMachine(RuleBasedStateMachine):
    """Rules of everything that may happen to a run, and what must always hold."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = Path(tempfile.mkdtemp(prefix="hrclog-machine-"))
        self.log = self.folder / "run.mcap"
        self.second = 0
        self.model = Model()
        self.recorder: Recorder | None = None

    def _clock(self) -> int:
        return BEGAN_NS + self.second * STEP_NS

    @initialize()
    def begin(self) -> None:
        """Begin the run."""
        self._open(resume=False)

    def _open(self, *, resume: bool) -> None:
        self.second += 2
        self.recorder = Recorder(self.log, agents=_AGENTS, clock_ns=self._clock, resume=resume)
        self.model.sizes = []
        self._note("run_started", "")

    def _note(self, kind: str, execution: str) -> None:
        self.model.rows.append(((kind, execution), self.second))
        self.model.sizes.append(self._journal().stat().st_size)

    def _journal(self) -> Path:
        return journal_path(segments(self.log)[-1])

    def _is_recording(self) -> bool:
        return self.recorder is not None

    def _live(self) -> Recorder:
        if self.recorder is None:
            raise RuntimeError("nothing is recorded")
        return self.recorder

    def _executions(self, *kinds: str) -> list[str]:
        return [key for key, last in self.model.phases().items() if not kinds or last in kinds]

    @rule(agent=st.sampled_from(_AGENTS), text=st.text(max_size=3), size=st.sampled_from((0, 3000)))
    @precondition(_is_recording)
    def start(self, agent: str, text: str, size: int) -> None:
        """Start a task, with text that may be anything."""
        self.second += 2
        details = {"text": text.encode(errors="replace").decode() + "x" * size}
        self._note("task_started", self._live().start(agent, "pick", details=details).execution_id)

    @rule(number=_NUMBERS, step=st.sampled_from(("task_ended", "task_paused", "task_resumed")))
    @precondition(_is_recording)
    def go_on(self, number: int, step: str) -> None:
        """End, pause or resume an execution, also where that is not allowed: then nothing is written."""
        executions = self._executions()
        if not executions:
            return
        self.second += 2
        execution = executions[number % len(executions)]
        handle = self._live().handle(execution)
        allowed = {
            "task_started": ("task_ended", "task_paused"),
            "task_resumed": ("task_ended", "task_paused"),
            "task_paused": ("task_ended", "task_resumed"),
        }.get(self.model.phases()[execution], ())
        acts: dict[str, Callable[[], None]] = {
            "task_ended": handle.end,
            "task_paused": handle.pause,
            "task_resumed": handle.resume,
        }
        act = acts[step]
        try:
            act()
        except IllegalEventError:
            assert step not in allowed
        else:
            assert step in allowed
            self._note(step, execution)

    @rule(value=st.floats(allow_nan=False, width=32))
    @precondition(_is_recording)
    def sample(self, value: float) -> None:
        """Record samples of a signal."""
        self._live().signal("distance", value)

    @rule()
    @precondition(_is_recording)
    def close(self) -> None:
        """End the run."""
        self.second += 2
        self._live().close()
        self.model.rows.append((("run_ended", ""), self.second))
        self.recorder = None

    @rule(torn=st.one_of(st.just(0), st.integers(0, 400)))
    @precondition(_is_recording)
    def kill(self, torn: int) -> None:
        """Drop the recorder without close, and leave a copy of its journal, perhaps without its last bytes."""
        journal = self._journal()
        recorder, self.recorder = self._live(), None
        data = journal.read_bytes()
        end = max(len(data) - torn, self.model.sizes[0])
        recorder._journal.close()  # type: ignore[union-attr]
        recorder._journal = None
        copy = journal.with_name("copy")
        copy.write_bytes(data[:end])
        copy.replace(journal)
        n_whole = sum(size <= end for size in self.model.sizes)
        # behind an event its lane is written: an event may be whole where what was written for it is not
        n_read = read_log(journal).events.height
        assert n_whole <= n_read <= n_whole + 1
        n_lost = len(self.model.sizes) - n_read
        self.model.rows = self.model.rows[: len(self.model.rows) - n_lost]
        self.model.is_torn |= end < len(data)

    @rule()
    @precondition(lambda self: not self._is_recording())
    def recover(self) -> None:
        """Close what a killed recorder left."""
        for journal in self.folder.glob("*.partial"):
            recover(journal)

    @rule()
    @precondition(lambda self: not self._is_recording())
    def resume(self) -> None:
        """Go on with the run."""
        self._open(resume=True)

    @rule(verdict=_VERDICTS, number=_NUMBERS)
    def judge_execution(self, verdict: str, number: int) -> None:
        """Say something of an execution."""
        executions = self._executions()
        if executions:
            self._judge(verdict, executions[number % len(executions)])

    @rule(verdict=_VERDICTS)
    def judge_run(self, verdict: str) -> None:
        """Say something of the run."""
        self._judge(verdict, "")

    @rule(verdict=_VERDICTS, first=st.integers(0, 20), length=st.integers(0, 6))
    def judge_span(self, verdict: str, first: int, length: int) -> None:
        """Say something of a span; its ends are odd seconds, at which nothing happens."""
        self._judge(verdict, (2 * first + 1, 2 * (first + length) + 3))

    @rule(number=_NUMBERS)
    def take_back(self, number: int) -> None:
        """Take back what stands, or what does not: then nothing is said."""
        targets = [*self.model.verdicts, *self._executions()]
        if not targets:
            return
        target = targets[number % len(targets)]
        try:
            annotate(self.folder, include=[self._text(target)])
        except HrclogError:
            assert target not in self.model.verdicts
        else:
            del self.model.verdicts[target]

    @rule(key=st.sampled_from(("trial", "who")), value=st.sampled_from(("1", "2", None)))
    def tag(self, key: str, value: str | None) -> None:
        """Set a tag, or take it back."""
        annotate(self.folder, {key: value})
        self.model.tags.pop(key, None)
        self.model.tags |= {} if value is None else {key: value}

    @rule()
    def refuse(self) -> None:
        """Say something of what is not there: nothing changes."""
        wrongs: list[dict[str, Any]] = [{"exclude": ["no such execution"]}, {"include": ["7..3"]}, {}]
        for wrong in wrongs:
            try:
                annotate(self.folder, reason="because" if wrong else "", **wrong)
            except HrclogError:
                continue
            raise AssertionError(wrong)

    def _judge(self, verdict: str, target: str | tuple[int, int]) -> None:
        said: dict[str, Any] = {verdict: [self._text(target)]}
        means_nothing = isinstance(target, tuple) and not self.model.touching(*target)
        try:
            annotate(self.folder, reason="because", **said)
        except HrclogError:
            assert means_nothing
        else:
            assert not means_nothing
            self.model.verdicts[target] = verdict

    def _text(self, target: str | tuple[int, int]) -> str:
        """Return a target as a user names it; the run began at second 2."""
        if isinstance(target, tuple):
            return "..".join(str(end - 2) for end in target)
        return target or "run"

    @invariant()
    def everything_is_read(self) -> None:
        """Compare what is read with the model."""
        if not self.model.rows:
            return
        everything = read_logs([self.folder], with_excluded=True)
        assert _rows(everything) == [row for row, _ in self.model.rows]
        errors = {finding.code for finding in everything.diagnostics if finding.severity == "error"}
        assert errors <= (TORN if self.model.is_torn else set()), errors
        assert _ids(not_learnt(everything.events)) == self.model.meant("not_learnt")
        assert next(iter(run_tags(everything.events).values()), {}) == self.model.tags
        counted = read_logs([self.folder])
        assert _rows(counted) == self.model.counted()

    def teardown(self) -> None:
        """Let go of the journal and remove the folder."""
        if self.recorder is not None:
            self.recorder._journal.close()  # type: ignore[union-attr]
        shutil.rmtree(self.folder)


def _rows(logs: Logs) -> list[Row]:
    """Return kind and execution of all events but remarks, in the order of writing."""
    events = logs.events.filter(pl.col("kind") != REMARK).sort("seq", maintain_order=True)
    assert events["seq"].is_unique().all()
    return events.select("kind", "execution_id").rows()


def _ids(rows: pl.DataFrame) -> set[str]:
    values: Iterable[str] = rows["execution_id"].to_list()
    return set(values)
