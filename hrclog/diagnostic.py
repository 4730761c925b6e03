"""What is remarkable about a log, as data: severity, code, place, message."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

Severity = Literal["error", "warning", "info"]

CODES: Final[dict[str, tuple[Severity, str]]] = {
    # data that was lost or skipped
    "unreadable_file": ("error", "a file or folder could not be read; the others were"),
    "limit_reached": ("error", "a file asks for more than its limit; what asks for it, or all behind it, was not read"),
    "missing_part": ("error", "a bag lists a part that is not there"),
    "no_header": ("error", "the file ends before its header, so it holds 0 events"),
    "truncated": ("error", "the file ends inside a record, whose bytes were ignored"),
    "corrupt_data": ("error", "bytes that are no valid record, or fail their checksum, were skipped"),
    "records_missing": ("error", "chunks or messages that the file lists or counts are not there"),
    "records_doubled": ("error", "records are in a file twice; their messages were counted once"),
    "foreign_records": ("error", "records are in a file that it does not list, or that belong to another file"),
    "damaged_index": ("error", "what a file says of its records does not fit them; the records themselves were read"),
    "broken_chain": (
        "error",
        "messages of a journal are missing, doubled, moved or not its own: its count does not go on",
    ),
    "recovered_with_losses": ("error", "the file was recovered from a damaged one; what that one lost is missing here"),
    "undecodable_event": ("error", "a message on an event channel could not be decoded and was skipped"),
    "overlaps_left_out": ("error", "so many executions or agents of a run overlap that its pairs were left out"),
    "events_missing": ("error", "the sequence numbers of a run have gaps: events were lost"),
    "unknown_event": ("error", "an event of a kind this version does not know was kept but not interpreted"),
    "end_without_start": ("error", "an execution ended that never started; the event was skipped"),
    "duplicate_start": ("error", "an execution id started twice; the later start was skipped"),
    "event_after_end": ("error", "something happened to an execution that had ended; the event was skipped"),
    "dispatch_after_start": ("error", "an execution was dispatched after it had started; the event was skipped"),
    "pause_without_start": ("error", "an execution was paused or resumed that had not started; the event was skipped"),
    "pause_while_paused": ("error", "an execution was paused twice; the later pause was skipped"),
    "resume_without_pause": ("error", "an execution resumed that was not paused; the event was skipped"),
    "identity_changed": ("error", "an execution changed its agent or task on the way; the event was skipped"),
    "missing_identity": ("error", "a task event names no agent, task or execution; the event was skipped"),
    "invalid_outcome": ("error", "an outcome is not in the vocabulary; the execution's outcome is unknown"),
    "invalid_time": ("error", "an event's instant is more than 73 years from 1970; the event was skipped"),
    "conflicting_runs": ("error", "two different runs carry the same id; their events cannot be told apart"),
    "unknown_outcome": ("error", "an outcome of the source has no known meaning; the message says what it counts as"),
    "skipped_row": ("error", "a row of the source could not be imported"),
    "skipped_message": ("error", "messages of a mapped topic could not be used and were left out"),
    "unmapped_value": ("error", "a value of the source is not in the lists of the mapping; its messages were left out"),
    "goal_not_recorded": (
        "error",
        "goals of an action are not in the recording; the name of the action stands for their task",
    ),
    "outside_runs": ("error", "executions lie outside of every run that the mapping tells; they were left out"),
    "end_unseen_start": ("error", "a task ended whose start is not in the recording; it was left out"),
    "no_events": ("error", "the file is readable but carries no events"),
    # worth a look, nothing lost
    "conflicting_seq": ("warning", "two different events of a run carry the same sequence number; both were kept"),
    "invalid_details": ("warning", "the details of an event are not a JSON object and were ignored"),
    "newer_schema": ("warning", "an event was written by a newer version; the fields known here were read"),
    "non_finite_value": ("warning", "a number was NaN or infinite and counts as unset"),
    "invalid_value": ("warning", "a value outside its range or vocabulary counts as unset"),
    "invalid_scene": ("warning", "a part of a recorded scene is not what it should be, and is not drawn"),
    "open_execution": ("warning", "an execution was still open when the log ended; it is counted as censored"),
    "self_overlap": ("warning", "an agent overlaps itself (two arms, or two people under one name)"),
    "zero_duration": ("warning", "an execution ended in the instant in which it started"),
    "implausible_time": ("warning", "a run began before 2000 or lasted longer than a week: a wrong unit or clock?"),
    "impossible_factor": ("warning", "an estimator gave a factor of 0 or less: the data do not support a factor there"),
    "unread_logs": ("warning", "logs lie beside those that were given, or in a folder of results, and were not read"),
    "not_imported": (
        "warning",
        "a recording of another system lies in a folder of logs: it carries no events, and was left out",
    ),
    "outcome_not_told": (
        "warning",
        "ends that tell no outcome, where others of their run or table do: they count as unknown",
    ),
    "outcome_assumed": ("warning", "no end of a run tells an outcome: its ended executions are counted as completed"),
    "no_run_start": ("warning", "times count from the start of a run, and nothing tells when that was: it is 1970"),
    "single_outcome": (
        "warning",
        "all executions have one outcome: if they succeeded, failures may have been removed (survivorship)",
    ),
    "no_run_id": (
        "warning",
        "events name no run; they are taken as one run of their file, or of files that go on from it",
    ),
    "never_set": ("warning", "values that a writer left at 0, and planned instants far from the run, count as unset"),
    "seq_never_set": ("warning", "every sequence number of a run is 0: its events count in the order of writing"),
    "doubtful_speed": ("warning", "a speed scale is 0 beside a mode that is no stop: was it never set?"),
    "clock_offset": (
        "warning",
        "an agent's clock is off, compared with others: its overlaps are wrong (`--clock` corrects it)",
    ),
    "clock_jump": (
        "warning",
        "the clock of an agent, or of all, jumps within a run: durations and overlaps across the jump are wrong",
    ),
    "clock_step": (
        "warning",
        "an execution's times run backwards: a clock was put back, and how long it took is not known",
    ),
    "clock_put_back": ("warning", "the recorder's clock was put back; the times of the run were shifted from there on"),
    "time_not_monotonic": ("warning", "times run backwards against the order of writing; the times were believed"),
    "ended_before": (
        "warning",
        "executions had ended when the recording began; when is not known, and they were left out",
    ),
    "start_assumed": ("warning", "executions were seen only when they had ended; they count from their acceptance"),
    "replayed_times": (
        "warning",
        "log times do not keep pace with the stamps of the messages: times taken from them are wrong",
    ),
    "standard_definition": (
        "warning",
        "types have no definition in the recording; they were read by the standard ones",
    ),
    "annotation_unmatched": ("warning", "annotations of a run that no log beside them holds: they were not read"),
    "exclusion_unmatched": ("warning", "an annotation excludes an execution or a span of which there is nothing"),
    "goals_unread": (
        "warning",
        "goals of an action are recorded without the definition of their type: all are called alike",
    ),
    "similar_names": ("warning", "names of agents or tasks differ only in what is easily overlooked: are they one?"),
    "missing_from_plan": ("warning", "items of a run's plan have no execution in it"),
    "short_run": ("warning", "a run has far fewer executions, in all or of a task, than other runs like it"),
    "before_run_start": ("warning", "events of a run are before its run_started"),
    "after_run_end": ("warning", "events of a run are after its run_ended"),
    "undeclared_agent": (
        "warning",
        "an agent has executions in a run whose run_started names agents, and not this one",
    ),
    "idle_agent": (
        "warning",
        "an agent has safety events in a run and no execution: is it another under another name?",
    ),
    "never_resumed": ("warning", "an execution was paused and did not resume before it ended, or the log did"),
    "planned_backwards": ("warning", "a planned end is before its planned start; both count as unset"),
    "long_execution": ("warning", "an execution took far longer than its task's median: was its end forgotten?"),
    "shared_execution_id": ("warning", "the same execution id is in several runs: was one copied into another?"),
    "wrong_unit": (
        "warning",
        "an agent's durations in a run are not of the size of work, of its plan, or of other runs: a wrong unit?",
    ),
    # facts
    "unfinished_log": ("info", "the log was not closed; every event in it was read (`hrclog recover` closes it)"),
    "assumed_definition": ("info", "our message type has no definition beside it; it was read by that of this version"),
    "foreign_type": ("info", "a topic of events carries messages of another type, which were not read"),
    "unprotected": (
        "info",
        "no checksum covers the messages of the file, or of the one it was recovered from: damage cannot be seen",
    ),
    "duplicate_events": ("info", "the same events were given more than once and counted once"),
    "excluded": (
        "info",
        "annotations exclude runs or executions, which do not count, or say that nothing is learnt from them",
    ),
    "identical_durations": ("info", "nearly all durations of a task are equal: filled in, or simulated"),
    "few_outcomes": ("info", "there are fewer than ten executions, and all have one outcome"),
    "unlisted_pairs": ("info", "there are so many tasks that only the pairs that overlapped are listed"),
    "one_agent": ("info", "the runs have a single agent: there are no synergies to estimate"),
    "run_not_ended": ("info", "the run has no run_ended event"),
    "clock_corrected": ("info", "the offset of an agent's clock was taken off its times"),
    "log_times_shifted": ("info", "log times are later or earlier than event times, for all agents alike"),
    "log_times_untimely": (
        "info",
        "log times do not keep pace with event times, of a run or an agent: clocks cannot be compared",
    ),
}
"""Every code, its severity and what it means. Errors mean that data was lost or skipped."""

TIMES_IN_DOUBT: Final = ("clock_offset", "clock_jump", "clock_step", "clock_put_back", "doubtful_speed")
"""Codes that stand beside every result that is computed from times: with them, factors and stop times may be wrong."""

ALWAYS_TOLD: Final = ("excluded",)
"""Codes of facts that every command tells: results are without what was left out."""

TIMES_CORRECTED: Final = "clock_corrected"


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """One finding: where (path, run, seq of the event, byte offset) and what."""

    code: str
    message: str
    path: str = ""
    run_id: str = ""
    seq: int | None = None
    offset: int | None = None

    @property
    def severity(self) -> Severity:
        """Return error (data lost or skipped), warning or info."""
        return CODES[self.code][0]

    def as_dict(self) -> dict[str, Any]:
        """Return the finding as a flat mapping, severity first."""
        return {"severity": self.severity, **asdict(self)}

    def __str__(self) -> str:
        place = self.path
        if self.seq is not None:
            place += f" (seq {self.seq})"
        elif self.offset is not None:
            place += f" (byte {self.offset})"
        return f"{self.severity}: {place + ': ' if place else ''}{self.message} [{self.code}]"


def loses_data(diagnostics: Iterable[Diagnostic]) -> bool:
    """Return whether any finding says that data was lost or skipped."""
    return any(diagnostic.severity == "error" for diagnostic in diagnostics)
