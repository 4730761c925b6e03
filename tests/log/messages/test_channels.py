"""Topics."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hrclog.errors import InvalidEventError
from hrclog.events import TaskEnded, TaskStarted
from hrclog.log.messages.channels import float_signal, joint_states, lane, topic_name
from hrclog.log.writing.lanes import Lanes


@given(st.text())
def test_any_text_gives_a_valid_ros_topic_token(text: str) -> None:
    assert re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", topic_name(text))
    assert "__" not in topic_name(text)


@given(st.sets(st.text(alphabet="aB_ /é\0🦾1", max_size=4), max_size=30))
def test_different_texts_give_different_tokens(texts: set[str]) -> None:
    assert len({topic_name(text) for text in texts}) == len(texts)


def test_a_plain_name_stays_as_it_is() -> None:
    assert topic_name("robot_1") == "robot_1"
    assert lane("robot").topic == "/hrc/agents/robot/active_task"
    assert joint_states("robot", "r").topic == "/hrc/agents/robot/joint_states"
    assert float_signal("distance", "r").topic == "/hrc/signals/distance"


def test_a_name_that_is_not_unicode_is_refused() -> None:
    with pytest.raises(InvalidEventError, match="expected valid Unicode"):
        topic_name("\ud800")


def _labels(lanes: Lanes, event: TaskStarted | TaskEnded) -> list[bytes]:
    return [message.data[8:-1] for message in lanes.after(event, 0)]


def test_a_lane_shows_the_task_that_began_last_and_nothing_when_idle() -> None:
    def start(name: str) -> TaskStarted:
        return TaskStarted(time_ns=1, agent="robot", task=name, execution_id=name)

    def end(name: str) -> TaskEnded:
        return TaskEnded(time_ns=1, agent="robot", task=name, execution_id=name)

    lanes = Lanes()
    events = [start("a"), start("b"), end("b"), end("a"), end("a")]
    assert [_labels(lanes, event) for event in events] == [[b"a"], [b"b"], [b"a"], [b""], []]
