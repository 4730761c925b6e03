"""Actions: whatever a recorder kept of a goal, it is one execution, from its begin to its first final state."""

from __future__ import annotations

import uuid
from collections.abc import Sequence
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mapped import Message, Row, S, T, events_of, rows, time_message, told
from sizes import many

from hrclog.events import CommandRejected, TaskDispatched, TaskEnded

STATUS = "action_msgs/msg/GoalStatusArray"
MAP = '[[action]]\ntopic = "/robot/{task}"\nagent = "robot"\n'
GOAL_MAP = '[[action]]\ntopic = "/robot/do"\nagent = "robot"\ntask = { field = "goal.task" }\n'
GOAL_MAP += 'reason = { field = "result.why" }\n'
OUTCOMES = {4: "succeeded", 5: "canceled", 6: "failed"}


def goal_id(name: str) -> dict[str, list[int]]:
    return {"uuid": list(uuid.uuid5(uuid.NAMESPACE_DNS, name).bytes)}


def array(time_ns: int, action: str, *states: tuple[str, int, int]) -> Message:
    """Return a status array of (goal, acceptance, state)."""
    entries = [
        {"goal_info": {"goal_id": goal_id(name), "stamp": time_message(stamp)}, "status": state}
        for name, stamp, state in states
    ]
    return time_ns, f"{action}/_action/status", STATUS, {"status_list": entries}


def service(time_ns: int, part: str, kind: int, number: int, content: dict[str, Any]) -> Message:
    info = {"event_type": kind, "client_gid": [0] * 16, "sequence_number": number}
    fields = {"info": info, "request": [], "response": [], ("request", "response")[kind // 2]: [content]}
    return time_ns, f"/robot/do/_action/{part}/_service_event", f"x/action/Do_{part}", fields


@settings(max_examples=many(30, fuzz=500))
@given(
    st.lists(st.tuples(st.integers(1, 60), st.integers(0, 60), st.sampled_from([4, 5, 6])), min_size=1, max_size=8),
    st.randoms(use_true_random=False),
)
def test_a_goal_is_one_execution_however_often_its_states_are_repeated(
    goals: list[tuple[int, int, int]], random: Random
) -> None:
    messages: list[Message] = []
    expected: list[Row] = []
    ended: list[tuple[str, int, int]] = []
    now = T
    for number, (wait, length, state) in enumerate(goals):
        start, name = now + wait * S, f"goal {number}"
        end = start + length * S
        expected.append(("robot", "pick", start, end, OUTCOMES[state]))
        stamp = start - S // 2
        for time_ns, current in (
            (stamp, 1),
            (start, 2),
            (start + length * S // 2, 2),
            (end, state),
            (end + S // 3, state),
        ):
            entries = [*ended[-3:], (name, stamp, current)]
            random.shuffle(entries)
            messages += [array(time_ns, "/robot/pick", *entries)] * random.randint(1, 2)
        ended.append((name, stamp, state))
        now = end + S
    facts, diagnostics = told(MAP, messages)
    assert rows(events_of(facts)) == expected
    assert diagnostics == []
    assert {fact.content.execution_id for fact in facts} == {  # type: ignore[union-attr]  # all of them are task facts
        str(uuid.uuid5(uuid.NAMESPACE_DNS, f"goal {number}")) for number in range(len(goals))
    }


def test_acceptance_is_a_dispatch_and_what_never_ends_stays_open() -> None:
    facts, _ = told(MAP, [array(T, "/robot/pick", ("a", T, 1)), array(T + S, "/robot/pick", ("a", T, 2))])
    assert isinstance(events_of(facts)[0], TaskDispatched)
    assert rows(events_of(facts)) == [("robot", "pick", T + S, None, "")]


def test_a_goal_that_shows_only_its_end_counts_from_its_acceptance() -> None:
    messages = [
        array(T, "/robot/pick", ("a", T, 1)),
        array(T + 3 * S, "/robot/pick", ("a", T, 4), ("b", T + 2 * S, 6)),
    ]
    facts, diagnostics = told(MAP, messages)
    both = [("robot", "pick", T, T + 3 * S, "succeeded"), ("robot", "pick", T + 2 * S, T + 3 * S, "failed")]
    assert rows(events_of(facts)) == both
    assert [finding.code for finding in diagnostics] == ["start_assumed"]
    assert diagnostics[0].message.startswith("2 executions of /robot/pick")


def test_what_had_ended_or_begun_before_the_recording() -> None:
    first = array(T, "/robot/pick", ("old", T - 99 * S, 4), ("running", T - 9 * S, 2))
    facts, diagnostics = told(MAP, [first, array(T + S, "/robot/pick", ("running", T - 9 * S, 4))])
    assert rows(events_of(facts)) == [("robot", "pick", T - 9 * S, T + S, "succeeded")]
    assert [finding.code for finding in diagnostics] == ["ended_before"]


@given(st.permutations(range(6)))
def test_task_and_reason_come_from_goal_and_result_in_any_order_of_the_messages(order: Sequence[int]) -> None:
    messages = [
        service(0, "send_goal", 1, 1, {"goal_id": goal_id("a"), "goal": {"task": "weld"}}),
        array(0, "/robot/do", ("a", 0, 2)),
        array(0, "/robot/do", ("a", 0, 6)),
        service(0, "get_result", 0, 9, {"goal_id": goal_id("a")}),
        service(0, "get_result", 3, 9, {"status": 6, "result": {"why": "no arc"}}),
        (0, "/robot/do/_action/feedback", "x", {"goal_id": goal_id("a"), "feedback": {}}),
    ]
    times = [T + 10 * S * place for place in order]
    times[1], times[2] = sorted(times[1:3])
    times[3], times[4] = sorted(times[3:5])
    facts, _ = told(GOAL_MAP, [(times[at], *message[1:]) for at, message in enumerate(messages)])
    assert rows(events_of(facts)) == [("robot", "weld", times[1], times[2], "failed")]
    assert [event.reason for event in events_of(facts) if isinstance(event, TaskEnded)] == ["no arc"]


def test_service_events_stand_in_for_a_status_that_was_not_recorded() -> None:
    messages = [
        service(T, "send_goal", 1, 1, {"goal_id": goal_id("a"), "goal": {"task": "weld"}}),
        service(T + 1, "send_goal", 2, 1, {"accepted": True}),
        service(T + 2, "get_result", 1, 1, {"goal_id": goal_id("a")}),
        service(T + 5 * S, "get_result", 2, 1, {"status": 4, "result": {"why": ""}}),
        service(T + 6 * S, "send_goal", 1, 2, {"goal_id": goal_id("b"), "goal": {"task": "cut"}}),
        service(T + 7 * S, "send_goal", 2, 2, {"accepted": False}),
        service(T + 7 * S + 1, "send_goal", 3, 2, {"accepted": False}),
    ]
    facts, diagnostics = told(GOAL_MAP, messages)
    assert rows(event for event in events_of(facts)) == [("robot", "weld", T + 1, T + 5 * S, "succeeded")]
    rejected = [event for event in events_of(facts) if isinstance(event, CommandRejected)]
    assert [(event.agent, event.task, event.time_ns) for event in rejected] == [("robot", "cut", T + 7 * S)]
    assert diagnostics == []


def test_a_goal_that_was_not_recorded_is_told_unless_the_mapping_has_a_default() -> None:
    messages = [array(T, "/robot/do", ("a", T, 2)), array(T + S, "/robot/do", ("a", T, 4))]
    facts, diagnostics = told(GOAL_MAP, messages)
    assert rows(events_of(facts)) == [("robot", "do", T, T + S, "succeeded")]
    assert [finding.code for finding in diagnostics] == ["goal_not_recorded"]
    facts, diagnostics = told(GOAL_MAP.replace('"goal.task"', '"goal.task", default = "any"'), messages)
    assert rows(events_of(facts)) == [("robot", "any", T, T + S, "succeeded")]
    assert diagnostics == []


def test_the_first_table_that_fits_an_action_counts() -> None:
    text = '[[action]]\ntopic = "/robot/do"\nagent = "arm"\ntask = "weld"\n' + MAP
    messages = [array(T + at * S, f"/robot/{name}", ("a", T, 2 + at)) for at in (0, 2) for name in ("do", "pick")]
    assert [row[:2] for row in rows(events_of(told(text, messages)[0]))] == [("arm", "weld"), ("robot", "pick")]


@pytest.mark.parametrize("days", [19, -3])
def test_a_replay_days_later_gives_the_times_of_the_stamps(days: int) -> None:
    shift = days * 86_400 * S
    steps = [(T + 10 * number * S, f"g{number}") for number in range(5)]
    messages = [
        array(time_ns + wait, "/robot/pick", (name, time_ns, state))
        for time_ns, name in steps
        for wait, state in ((0, 1), (S, 2), (4 * S, 4))
    ]
    before, diagnostics = told(MAP, messages)
    assert diagnostics == []
    after, diagnostics = told(MAP, [(message[0] + shift, *message[1:]) for message in messages])
    assert rows(events_of(after)) == rows(events_of(before))
    assert [finding.code for finding in diagnostics] == ["log_times_shifted"]
    fast = [(T + shift + (message[0] - T) // 10, *message[1:]) for message in messages]
    assert [finding.code for finding in told(MAP, fast)[1]] == ["replayed_times"]


def ros1(time_ns: int, part: str, stamp_ns: int, **fields: Any) -> Message:  # noqa: ANN401 - of any message
    kinds = {
        "status": "actionlib_msgs/msg/GoalStatusArray",
        "goal": "x/msg/DoActionGoal",
        "result": "x/msg/DoActionResult",
    }
    header = {"stamp": {"secs": stamp_ns // S, "nsecs": stamp_ns % S}}
    return time_ns, f"/robot/do/{part}", kinds[part], {"header": header, **fields}


def state_of(name: str, state: int, text: str = "") -> dict[str, Any]:
    return {"goal_id": {"id": name, "stamp": {"secs": 0, "nsecs": 0}}, "status": state, "text": text}


@given(st.sampled_from([(2, "canceled"), (3, "succeeded"), (4, "failed")]), st.integers(0, 3), st.integers(-5, 5))
def test_a_goal_of_ros_1_runs_from_its_first_active_status_to_its_result(
    end: tuple[int, str], n_repeated: int, late: int
) -> None:
    state, outcome = end
    days = late * 86_400 * S  # log times of a replay: the stamps count
    messages = [
        ros1(T + days - S, "goal", T - S, goal_id={"id": "g"}, goal={"task": "weld"}),
        ros1(T + days - S, "status", T - S, status_list=[state_of("g", 0)]),
        *[ros1(T + days + n, "status", T + n, status_list=[state_of("g", 1)]) for n in range(n_repeated + 1)],
        ros1(T + days + 5 * S, "result", T + 5 * S, status=state_of("g", state, "so"), result={"why": ""}),
        *[
            ros1(T + days + 6 * S + n, "status", T + 6 * S, status_list=[state_of("g", state)])
            for n in range(n_repeated)
        ],
    ]
    facts, diagnostics = told(GOAL_MAP, messages)
    assert rows(events_of(facts)) == [("robot", "weld", T, T + 5 * S, outcome)]
    assert [event.reason for event in events_of(facts) if isinstance(event, TaskEnded)] == ["so"]
    assert diagnostics == []


def test_refused_and_recalled_goals_of_ros_1_are_rejected_commands() -> None:
    messages = [
        ros1(T, "status", T, status_list=[state_of("a", 0), state_of("b", 0)]),
        ros1(T + S, "status", T + S, status_list=[state_of("a", 5, "busy"), state_of("b", 8)]),
        ros1(T + S + 1, "result", T + S, status=state_of("a", 5, "busy"), result={}),
    ]
    facts, _ = told(MAP.replace("{task}", "do") + 'task = "do"\n', messages)
    assert [event.reason for event in events_of(facts) if isinstance(event, CommandRejected)] == [
        "busy",
        "recalled before it began",
    ]
    assert rows(event for event in events_of(facts)) == []


@given(st.booleans(), st.integers(2, 4))
def test_ids_that_recur_in_other_actions_or_later_are_other_executions(with_requests: bool, n_rounds: int) -> None:
    messages: list[Message] = []
    expected: list[Row] = []
    for number in range(n_rounds):
        start = T + number * 20 * S
        for task in ("do", "pick"):
            action = f"/robot/{task}"
            expected.append(("robot", task, start, start + 5 * S, "succeeded"))
            kept = [("g", start - 20 * S, 4)] * bool(number)
            messages += [
                array(start, action, *kept, ("g", start, 2)),
                array(start + 5 * S, action, ("g", start, 4), *kept),
            ]
        if with_requests:
            request = {"goal_id": goal_id("g"), "goal": {}}
            messages.append(service(start - 1, "send_goal", 1, number, request))
    facts, diagnostics = told(MAP, messages)
    assert rows(events_of(facts)) == expected
    assert diagnostics == []
