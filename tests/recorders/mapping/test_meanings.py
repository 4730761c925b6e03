"""PlanSys2, Nav2, messages of one's own, safety, signals and runs: laws of what topics mean."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mapped import Message, Row, S, T, events_of, rows, runs, time_message, told
from sizes import many

from hrclog.errors import MappingError
from hrclog.events import SafetyStateChanged, TaskEnded, TaskPaused, TaskResumed, TaskStarted
from hrclog.log.messages.encode import FloatSignal, JointSignal

OUTCOMES = {3: "failed", 4: "succeeded", 5: "canceled"}
STATE_MAP = """
[[task]]
topic = "/state"
agent = { field = "agent" }
task = { field = "job" }
state = { field = "state" }
reason = { field = "text" }
started = [1, "go"]
succeeded = [2]
failed = [3]
paused = [4]
ignored = [9]
"""


def report(log_ns: int, name: str, status: int, start: int, changed: int) -> Message:
    fields = {
        "status": status, "action_full_name": name, "action": name[1:].partition(" ")[0], "arguments": ["r1", "table"],
        "start_stamp": time_message(start), "status_stamp": time_message(changed), "duration": time_message(4 * S),
        "message_status": "",
    }  # fmt: skip
    return log_ns, "/action_execution_info", "plansys2_msgs/msg/ActionExecutionInfo", fields


@settings(max_examples=many(25, fuzz=500))
@given(
    st.lists(st.tuples(st.integers(1, 20), st.integers(0, 20), st.sampled_from([3, 4, 5])), min_size=1, max_size=5),
    st.sampled_from([0, 19 * 86_400 * S]),
    st.sampled_from([1, 100]),
)
def test_plansys2_repeats_each_second_and_only_its_own_times_count(
    actions: list[tuple[int, int, int]], shift: int, speed: int
) -> None:
    plan, now = [], T
    for number, (wait, length, status) in enumerate(actions):
        start = now + wait * S
        now = start + length * S
        plan.append((f"(pick r1 b{number}):{number * 4000}", start, now, status))
    messages = []
    for second in range((now - T) // S + 3):
        at = T + second * S
        for name, start, end, status in plan:
            current = 1 if at < start else 2 if at < end else status
            stamps = {1: (T, T), 2: (start, start)}.get(current, (start, end))
            messages.append(report(T + shift + second * S // speed, name, current, *stamps))
    text = '[[plansys2]]\nagent = { field = "arguments[0]", names = { r1 = "robot" } }\n'
    facts, diagnostics = told(text, messages)
    assert rows(events_of(facts)) == [("robot", "pick", start, end, OUTCOMES[how]) for _, start, end, how in plan]
    planned = {event.time_ns: event.planned_start_ns for event in events_of(facts) if isinstance(event, TaskStarted)}
    assert planned == {start: T + number * 4 * S for number, (_, start, _, _) in enumerate(plan)}
    assert diagnostics == []


def test_nodes_of_a_tree_run_from_running_to_their_end_or_halt() -> None:
    steps = [
        (1, "Pick", "IDLE", "RUNNING"), (1, "Root", "IDLE", "RUNNING"), (3, "Pick", "RUNNING", "FAILURE"),
        (3, "Pick", "FAILURE", "IDLE"), (4, "Pick", "IDLE", "RUNNING"), (6, "Pick", "RUNNING", "IDLE"),
        (7, "Check", "IDLE", "SUCCESS"), (8, "Pick", "IDLE", "RUNNING"), (9, "Pick", "IDLE", "RUNNING"),
    ]  # fmt: skip
    messages: list[Message] = [
        (T + 500 * S, "/behavior_tree_log", "nav2_msgs/msg/BehaviorTreeLog", {"event_log": [
            {"timestamp": time_message(T + at * S), "node_name": name,
             "previous_status": before, "current_status": after}
        ]})
        for at, name, before, after in steps
    ]  # fmt: skip
    facts, _ = told('[[behavior_tree]]\nagent = "robot"\nnodes = ["P*", "Check"]\n', messages)
    assert rows(events_of(facts)) == [
        ("robot", "Pick", T + S, T + 3 * S, "failed"),
        ("robot", "Pick", T + 4 * S, T + 6 * S, "canceled"),
        ("robot", "Pick", T + 8 * S, T + 9 * S, ""),
        ("robot", "Pick", T + 9 * S, None, ""),
    ]


@given(st.lists(st.tuples(st.sampled_from("ab"), st.sampled_from("xy"), st.sampled_from([1, 2, 3, 4, 9])), max_size=30))
def test_states_may_be_repeated_and_come_in_any_order(changes: list[tuple[str, str, int]]) -> None:
    messages: list[Message] = []
    for number, (agent, job, state) in enumerate(changes):
        fields = {"agent": agent, "job": job, "state": state, "text": "why"}
        messages += [(T + number * S, "/state", "x/msg/State", fields)] * (1 + number % 3)
    facts, _ = told(STATE_MAP, messages)
    open_since: dict[tuple[str, str], int] = {}
    expected: list[Row] = []
    for number, (agent, job, state) in enumerate(changes):
        key, at = (agent, job), T + number * S
        if state == 1:
            open_since.setdefault(key, at)
        elif state in (2, 3) and key in open_since:
            expected.append((*key, open_since.pop(key), at, "succeeded" if state == 2 else "failed"))
    expected += [(*key, start, None, "") for key, start in open_since.items()]
    assert rows(events_of(facts)) == sorted(expected, key=lambda row: (row[2], row[:2]))
    for events in by_execution(events_of(facts)):
        halted = False
        for event in events:
            if isinstance(event, TaskPaused):
                assert not halted
            if isinstance(event, TaskResumed):
                assert halted
            halted = isinstance(event, TaskPaused) or (halted and not isinstance(event, TaskResumed))


def by_execution(events: list[Any]) -> list[list[Any]]:
    found: dict[str, list[Any]] = {}
    for event in events:
        found.setdefault(event.execution_id, []).append(event)
    return list(found.values())


def test_what_a_mapping_does_not_know_is_counted_and_left_out() -> None:
    known = {"agent": "a", "job": "x", "text": ""}
    messages: list[Message] = [
        (T, "/state", "x", {**known, "state": 77}),
        (T + 1, "/state", "x", {**known, "state": 77}),
        (T + 2, "/state", "x", {**known, "state": 2}),
        (T + 3, "/state", "x", {"agent": "a", "state": 1}),
    ]
    facts, diagnostics = told(STATE_MAP, messages)
    assert facts == []
    assert sorted(finding.code for finding in diagnostics) == ["end_unseen_start", "skipped_message", "unmapped_value"]
    assert any("2 messages of /state: the state '77' is in no list" in finding.message for finding in diagnostics)


def test_a_topic_may_tell_what_an_agent_does_and_only_some_messages_may_count() -> None:
    text = '[[task]]\ntopic = "/{agent}/now"\ntask = { field = "data" }\nidle = ["", "none"]\n'
    text += 'only = "device"\nis = ["arm", 7]\n'
    said = ["", "pick", "pick", "place", "none", "none", "pick"]
    messages: list[Message] = [
        (T + number * S, "/robot/now", "x", {"data": task, "device": device})
        for number, task in enumerate(said)
        for device in ("arm", "other")
    ]
    facts, _ = told(text, messages)
    assert rows(events_of(facts)) == [
        ("robot", "pick", T + S, T + 3 * S, ""), ("robot", "place", T + 3 * S, T + 4 * S, ""),
        ("robot", "pick", T + 6 * S, None, ""),
    ]  # fmt: skip
    assert [event.outcome for event in events_of(facts) if isinstance(event, TaskEnded)] == ["", ""]


@given(st.lists(st.tuples(st.booleans(), st.integers(0, 100)), max_size=25))
def test_safety_changes_once_for_each_change(samples: list[tuple[bool, int]]) -> None:
    text = '[[safety]]\ntopic = "/mode"\nagent = "robot"\nmode = "mode"\nmodes = { 0 = "ok", 1 = "stop" }\n'
    text += '[[safety]]\ntopic = "/speed"\nagent = "robot"\nspeed = "data"\nunit = "percent"\n'
    messages: list[Message] = []
    state: tuple[str, float | None] = ("", None)
    expected = []
    for number, (is_mode, value) in enumerate(samples):
        at = T + number * S
        topic, fields = ("/mode", {"mode": value % 2}) if is_mode else ("/speed", {"data": float(value)})
        messages.append((at, topic, "x", fields))
        changed = (("ok", "stop")[value % 2], state[1]) if is_mode else (state[0], value / 100)
        if changed != state:
            state = changed
            expected.append((at, *state))
    events = events_of(told(text, messages)[0])
    assert all(isinstance(event, SafetyStateChanged) and event.agent == "robot" for event in events)
    assert [(event.time_ns, event.mode, event.speed_scale) for event in events] == expected  # type: ignore[attr-defined]  # all of them are safety changes


def test_a_speed_out_of_its_range_is_no_speed() -> None:
    text = '[[safety]]\ntopic = "/speed"\nagent = "robot"\nspeed = "data"\nunit = "fraction"\n'
    values = [0.5, 50.0, float("nan"), -1.0, 1.0000001]
    messages: list[Message] = [(T + number, "/speed", "x", {"data": value}) for number, value in enumerate(values)]
    facts, diagnostics = told(text, messages)
    assert [event.speed_scale for event in events_of(facts)] == [0.5, 1.0]  # type: ignore[attr-defined]  # all of them are safety changes
    assert [finding.code for finding in diagnostics] == ["skipped_message"] * len(diagnostics)


def test_numbers_and_joints_are_signals_by_the_time_that_they_tell() -> None:
    text = '[[signal]]\ntopic = "/d"\nname = "distance"\nfield = "all[1]"\nfactor = 0.001\n'
    text += 'time = { field = "at", unit = "ms" }\n[[joints]]\nagent = "arm"\n'
    messages: list[Message] = [
        (T, "/d", "x", {"all": [0, 250], "at": T // 10**6 + 7}),
        (T, "/joint_states", "x", {"header": {"stamp": time_message(T + 5)}, "name": ["a", "b"], "position": [1, 2.5]}),
    ]
    facts, _ = told(text, messages)
    assert [fact.content for fact in facts] == [
        FloatSignal("", "distance", T + 7 * 10**6, 0.25),
        JointSignal("", "arm", T + 5, ("a", "b"), (1.0, 2.5)),
    ]
    with pytest.raises(MappingError, match="expected a Time, or a unit"):
        told(text.replace(', unit = "ms"', ""), messages)


def state(at: int, number: int, agent: str = "a") -> Message:
    return T + at * S, "/state", "x", {"agent": agent, "job": "x", "state": number, "text": ""}


def test_attempts_count_on_until_one_succeeds() -> None:
    ends = [3, 3, 2, 2, 3]
    messages = [part for n, end in enumerate(ends) for part in (state(10 * n, 1), state(10 * n + 5, end))]
    [run], _ = runs(STATE_MAP, messages)
    assert [event.attempt for event in run.events if isinstance(event, TaskStarted)] == [1, 2, 3, 1, 1]
    assert [event.kind for event in run.events][0::11] == ["run_started", "run_ended"]


def test_runs_are_divided_where_nobody_does_anything() -> None:
    messages = [
        *(state(at, number, "a") for at, number in ((0, 1), (50, 2), (55, 1), (70, 2), (200, 1), (210, 2))),
        *(state(at, number, "b") for at, number in ((5, 1), (65, 2))),
    ]
    found, _ = runs('[run]\nby = "gap"\ngap_s = 20\n' + STATE_MAP, messages)
    assert [(run.name, run.n_executions) for run in found] == [("bag_1", 3), ("bag_2", 1)]
    assert len({run.run_id for run in found}) == 2
    spans = [(run.events[0].time_ns - T, run.events[-1].time_ns - T) for run in found]
    assert spans == [(0, 70 * S), (200 * S, 210 * S)]


def test_a_topic_tells_runs_by_name_or_by_begin_and_end() -> None:
    work = [state(at, number) for at, number in ((0, 1), (5, 2), (20, 1), (25, 2), (40, 1), (45, 2))]
    safety = '[[safety]]\ntopic = "/mode"\nagent = "a"\nmode = "mode"\n'
    before: Message = (T - S, "/mode", "x", {"mode": "reduced"})
    names: list[Message] = [
        (T + at * S, "/run", "x", {"data": name}) for at, name in ((10, "r1"), (30, "r2"), (30, "r2"), (50, ""))
    ]
    text = '[run]\nby = "topic"\ntopic = "/run"\nname = { field = "data" }\n' + STATE_MAP + safety
    found, diagnostics = runs(text, [before, *work, *names])
    assert [(run.name, run.events[0].time_ns, run.n_executions) for run in found] == [
        ("r1", T + 10 * S, 1), ("r2", T + 30 * S, 1),
    ]  # fmt: skip
    assert [finding.code for finding in diagnostics] == ["outside_runs"]
    assert {type(run.events[1]) for run in found} == {SafetyStateChanged}
    flags: list[Message] = [(T + at * S, "/run", "x", {"data": on}) for at, on in ((10, True), (30, False), (31, True))]
    text = text.replace("name = {", "state = {")
    found, _ = runs(text, [*work, *flags])
    assert [(run.name, run.n_executions, run.events[-1].kind) for run in found] == [
        ("bag_1", 1, "run_ended"), ("bag_2", 1, "task_ended"),
    ]  # fmt: skip
