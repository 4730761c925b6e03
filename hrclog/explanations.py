"""What causes each diagnostic, and what to do: for `hrclog check --explain`, and told in docs/diagnostics.md too."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Explanation:
    """What usually causes a diagnostic, and what a user does about it."""

    cause: str
    remedy: str


_RECOVER: Final = "Run `hrclog recover` on the file and compare it with a copy from where it was recorded."
_COPY_AGAIN: Final = "Copy the file again from where it was recorded; what hrclog could read is in the results."
_FIX_WRITER: Final = "Correct what writes the events: the page docs/events.md says what each field means."
_FIX_ORDER: Final = "Correct what writes the events: docs/events.md says which event may follow which."
_FIX_MAPPING: Final = "Complete the mapping file and import again; docs/bags.md lists what it may say."

EXPLANATIONS: Final[dict[str, Explanation]] = {
    code: Explanation(cause, remedy)
    for code, (cause, remedy) in {
        "unreadable_file": (
            "The file is damaged from its first bytes, is of another format, or may not be read.",
            "Check its permissions and whether it is a log; the other files were read.",
        ),
        "limit_reached": (
            "The file is damaged or made to harm: it asks for far more memory or time than its size explains.",
            "Copy it again from where it was recorded; docs/reliability.md lists the limits.",
        ),
        "missing_part": (
            "A bag's metadata.yaml lists a file that was renamed, moved or not copied.",
            "Put the file back beside the others under the name that the metadata gives.",
        ),
        "no_header": ("The copy broke off at once, or the recorder was killed before it wrote anything.", _COPY_AGAIN),
        "truncated": ("The recorder was killed in the middle of a write, or a copy broke off.", _RECOVER),
        "corrupt_data": ("A disk or a transfer changed bytes of the file.", _COPY_AGAIN),
        "records_missing": ("A tool cut the file, or its index was written for another version of it.", _COPY_AGAIN),
        "records_doubled": (
            "Two copies of the file, or of a part, were joined.",
            "Use the file as it was recorded; the doubled messages were counted once.",
        ),
        "foreign_records": ("Two files were joined, or part of one was written over another.", _COPY_AGAIN),
        "damaged_index": (
            "A tool changed the file without writing its index anew.",
            "Run `hrclog recover` on the file: it writes a new index.",
        ),
        "broken_chain": ("A journal was edited, or parts of several journals were joined.", _COPY_AGAIN),
        "recovered_with_losses": (
            "`hrclog recover` made this file from a damaged one.",
            "Read what was lost in the message; leave the run out where that matters.",
        ),
        "undecodable_event": (
            "A message is not of the type that its channel names, or its bytes were changed.",
            "Compare the message definitions of the writer with docs/TaskEvent.msg.",
        ),
        "overlaps_left_out": (
            "Executions lack their ends, several runs were recorded as one, or agents are far too many.",
            "Correct what writes the ends, or split the runs; durations are as they were recorded.",
        ),
        "events_missing": (
            "Messages were dropped on their way, or somebody deleted events.",
            "Look for the other files of the run; record with a reliable quality of service.",
        ),
        "unknown_event": (
            "A newer hrclog, or another program, wrote the event.",
            "Update hrclog, or correct the kind of the event.",
        ),
        "end_without_start": ("The start was not recorded, or start and end carry different ids.", _FIX_ORDER),
        "duplicate_start": ("Two executions were given one id, or a start was sent twice.", _FIX_ORDER),
        "event_after_end": ("Two executions were given one id, or an end was sent twice.", _FIX_ORDER),
        "dispatch_after_start": ("The dispatch was written late, or twice.", _FIX_ORDER),
        "pause_without_start": ("The start was not recorded, or the pause carries another id.", _FIX_ORDER),
        "pause_while_paused": ("A resume was not recorded, or two causes paused the execution.", _FIX_ORDER),
        "resume_without_pause": ("The pause was not recorded, or the resume was sent twice.", _FIX_ORDER),
        "identity_changed": ("Two executions were given one id.", _FIX_ORDER),
        "missing_identity": ("The writer left agent, task or execution_id empty.", _FIX_WRITER),
        "invalid_outcome": ("The writer has words of its own for outcomes.", _FIX_WRITER),
        "invalid_time": ("The instant is in another unit, or was never set.", _FIX_WRITER),
        "conflicting_runs": (
            "A run's id was fixed in a script, or a log was copied and changed.",
            "Give every run an id of its own, and give such logs to hrclog one by one.",
        ),
        "unknown_outcome": (
            "The source has words of its own for outcomes.",
            "Import again and say what the word means: --ok, --failed or --canceled.",
        ),
        "skipped_row": (
            "A cell of the row is empty or is not what its column asks for.",
            "Correct the row and import again.",
        ),
        "skipped_message": ("The message lacks a field that the mapping reads, or is damaged.", _FIX_MAPPING),
        "unmapped_value": ("The recording holds a value that the mapping does not name.", _FIX_MAPPING),
        "goal_not_recorded": (
            "The service events of the action's send_goal were not recorded.",
            "Record them too; docs/bags.md says how.",
        ),
        "outside_runs": ("The mapping's runs do not cover the whole recording.", _FIX_MAPPING),
        "end_unseen_start": (
            "The recording began after the task did.",
            "Begin to record before the first task; the task was left out.",
        ),
        "no_events": (
            "The file holds other topics only, or the recorder wrote no event.",
            "`hrclog info` lists its channels; a bag of actions is imported with `hrclog import bag`.",
        ),
        "conflicting_seq": (
            "Two programs numbered the events of a run each by itself.",
            "Let one recorder number them, or leave seq unset everywhere.",
        ),
        "invalid_details": ("The writer put another text there than a JSON object.", _FIX_WRITER),
        "newer_schema": ("A newer hrclog wrote the event.", "Update hrclog to read all of it."),
        "non_finite_value": ("A division by 0, or a sensor without a value.", _FIX_WRITER),
        "invalid_value": ("A value of another unit or of another vocabulary.", _FIX_WRITER),
        "invalid_scene": (
            "A topic of the scene is incomplete or of another form.",
            "docs/log-format.md says what a scene may hold; results do not depend on it.",
        ),
        "open_execution": (
            "The recorder stopped before the task did, or its end was never written.",
            "Nothing, if the run broke off; otherwise see that every task writes its end.",
        ),
        "self_overlap": (
            "Two people or two arms share one name, or ends are written late.",
            "Give each its own name; what it costs is in the message.",
        ),
        "zero_duration": (
            "Start and end are written together when a task is done, or times have whole seconds only.",
            "Write the start when the task starts; such executions teach a duration of 0.",
        ),
        "implausible_time": (
            "Instants in s, ms or us where ns are expected, simulated time, or a clock that was never set.",
            "Multiply the instants, or set the clock before recording; durations are right if the unit is.",
        ),
        "impossible_factor": (
            "A linear fit to few or contradicting executions.",
            "Take the estimator aft, or more runs; do not use the factor.",
        ),
        "unread_logs": (
            "A folder was given that holds others, or files of another name.",
            "Name them too, or a glob such as `runs/**/*.mcap`.",
        ),
        "not_imported": (
            "A bag or another recording without events of hrclog lies among logs.",
            "Import it with the command that the message names, or leave it: the logs were read.",
        ),
        "outcome_not_told": (
            "A writer or a table leaves the outcome empty at times.",
            "Fill it in at the source; such executions teach no durations.",
        ),
        "outcome_assumed": (
            "The source records no outcomes at all.",
            "Record them: an execution that failed counts as one that was done.",
        ),
        "no_run_start": (
            "A table has times that count from the start of a run, and no column or option says when that was.",
            "Say it when importing; durations and overlaps are right all the same.",
        ),
        "single_outcome": (
            "Failed executions were deleted or repeated without a word, or a column of outcomes was filled in.",
            "Ask who recorded; success rates mean nothing here. Executions that a simulation made are not counted.",
        ),
        "no_run_id": ("The writer left run_id empty.", "Set it: two runs in one folder may be taken for one."),
        "never_set": (
            "A node of ROS sends fields that it never sets, which are 0.",
            "Set them, or ignore it: they count as unset.",
        ),
        "seq_never_set": (
            "A node never sets seq.",
            "Number the events of a run from 0, so that lost ones can be seen.",
        ),
        "doubtful_speed": (
            "A node sends 0 because it does not know the speed.",
            "Set speed_scale, or a mode that names a stop.",
        ),
        "clock_offset": (
            "The computers of agents are not synchronised.",
            "Correct it with --clock AGENT=OFFSET, and synchronise them (docs/clocks.md).",
        ),
        "clock_jump": (
            "A clock was set during the run.",
            "Leave the executions around the jump out; synchronise clocks before recording.",
        ),
        "clock_step": (
            "A clock was put back while the execution went on.",
            "Synchronise clocks before recording; the execution counts as open.",
        ),
        "clock_put_back": (
            "The recorder's clock was put back between two parts of the run.",
            "Nothing within the parts; do not trust the pause between them.",
        ),
        "time_not_monotonic": (
            "Events are written late, or by several computers.",
            "Nothing, if they carry when they happened; otherwise see docs/clocks.md.",
        ),
        "ended_before": (
            "Recording began while actions were known to have ended.",
            "Begin to record before the first task; the executions were left out.",
        ),
        "start_assumed": (
            "The status of the action was recorded at its end only.",
            "Record its status and feedback topics too; the durations may be too long.",
        ),
        "replayed_times": (
            "The recording was made of a replay.",
            "Map the stamps of the messages instead of their log times.",
        ),
        "standard_definition": (
            "The recorder wrote no message definitions.",
            "Nothing, if the package of the types is of the same version.",
        ),
        "annotation_unmatched": (
            "The log was replaced or renamed since it was annotated, or another log has taken its name.",
            "Put the annotations beside their log again: RUN.annotations.mcap beside RUN.mcap.",
        ),
        "exclusion_unmatched": (
            "The log was replaced since it was annotated, or the annotations are those of another log.",
            "Take the exclusion back with `hrclog annotate LOG --include`, or put the right log in place.",
        ),
        "goals_unread": (
            "The bag holds the goals of an action, but its recorder stored no definition of their type.",
            "Give the goal of the .action file in the mapping (`definition`), and the field that names the task.",
        ),
        "similar_names": (
            "One name was typed in several ways.",
            "Correct it at the source if they are one; otherwise choose names that differ more.",
        ),
        "missing_from_plan": (
            "The run was broken off, executions were deleted, or they carry other ids or names than the plan.",
            "Compare the run with its plan; leave it out of makespans if it is incomplete.",
        ),
        "short_run": (
            "The run was broken off or recorded in part, or executions were deleted.",
            "Look for its other files; leave it out of makespans if it is incomplete. Give runs of another kind a tag.",
        ),
        "before_run_start": (
            "An agent's clock is behind, the start was written late, or events of another run carry this run's id.",
            "See docs/clocks.md, or write run_started before all else.",
        ),
        "after_run_end": (
            "An agent's clock is ahead, work went on after the end, or events of another run carry this run's id.",
            "See docs/clocks.md, or write run_ended when all is over.",
        ),
        "undeclared_agent": (
            "A name was mistyped, or an agent joined that nobody declared.",
            "Correct the name at the source, or name the agent in run_started.",
        ),
        "idle_agent": (
            "The safety function calls an agent by another name than its tasks do.",
            "Use one name: stop times and mean speeds are taken from the safety events of the agent that works.",
        ),
        "never_resumed": (
            "The resume was not written, or the execution was given up during its pause.",
            "Write task_resumed when work goes on: all from the pause to the end counts as paused.",
        ),
        "planned_backwards": (
            "The two columns were swapped, or are in different units.",
            "Correct them at the source; lateness and planned durations leave such executions out.",
        ),
        "long_execution": (
            "Somebody forgot to press end, the cell stood still, or the end has another unit.",
            "Look at the execution; `--outliers isolation-forest` leaves such ones out of the estimates.",
        ),
        "shared_execution_id": (
            "A run was copied and changed, or a writer counts executions anew in each run.",
            "Keep one of the copies, or make ids that no other run has (UUIDs).",
        ),
        "wrong_unit": (
            "A writer gives ms or us where s are meant, or the other way round.",
            "Correct the unit where the durations are written or imported.",
        ),
        "unfinished_log": (
            "The recorder is still running, or was killed.",
            "`hrclog recover` closes the log; every event in it was read.",
        ),
        "assumed_definition": (
            "Another program wrote our message type without its definition.",
            "Write the definition of docs/TaskEvent.msg beside it.",
        ),
        "foreign_type": (
            "A topic has the name of ours and another type.",
            "Nothing, if it holds no events; otherwise import it with a mapping.",
        ),
        "unprotected": (
            "The writer of the file makes no checksums.",
            "Switch checksums on in the recorder, so that damage can be seen.",
        ),
        "duplicate_events": (
            "A log was given twice, or a journal lies beside its finished log.",
            "Nothing; the events were counted once.",
        ),
        "excluded": (
            "Somebody said with `hrclog annotate` that runs or executions do not count, or teach nothing.",
            "Nothing; `hrclog annotate LOG --include` takes it back.",
        ),
        "identical_durations": (
            "A column was filled in, an agent is scripted or simulated, or times are too coarse.",
            "Ask where the durations come from: they have no spread to learn.",
        ),
        "few_outcomes": (
            "Chance, in so few executions, or the same as for single_outcome.",
            "Record more runs before you trust a success rate.",
        ),
        "unlisted_pairs": (
            "Tasks carry serial numbers, so that each is done once.",
            "Give equal work an equal task name, and tell items apart by item_id.",
        ),
        "one_agent": ("Only one agent was recorded.", "Nothing; durations and metrics are there."),
        "run_not_ended": (
            "The recorder is still running, or stopped before the run did.",
            "Nothing, if the run broke off; otherwise write run_ended.",
        ),
        "clock_corrected": ("--clock was given.", "Nothing; the message says by how much."),
        "log_times_shifted": (
            "The recorder's clock differs from that of the events, or messages arrive late.",
            "Nothing: times of the events are used.",
        ),
        "log_times_untimely": (
            "The log was written after the events, as imports and replays do.",
            "Nothing: times of the events are used, and clocks cannot be compared.",
        ),
    }.items()
}
"""Cause and remedy of every code of `hrclog.diagnostic.CODES`."""
