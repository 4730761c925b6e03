"""A mapping file says only what has a meaning; everything else is told, all at once and with its place."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mapped import cell
from sizes import many

from hrclog.errors import MappingError
from hrclog.recorders.mapping.mapping import read_mapping
from hrclog.recorders.mapping.meanings import MEANINGS
from hrclog.recorders.mapping.suggest import suggestion

PAGE = Path(__file__).parents[3] / "docs" / "bags.md"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "found no table"),
        ("[[actions]]", "found the table 'actions', expected one of action, plansys2"),
        ("[action]\ntopic = '/a'", r"expected it in double brackets: \[\[action\]\]"),
        ("[[action]]\ntopic = '/a'\nagent = 'r'", r"action\[1\]: task: found nothing"),
        (
            "[[action]]\ntopic = '/a'\nagent = 'r'\ntask = 't'\nagnet = 1",
            "found the key 'agnet', expected one of agent",
        ),
        ("[[action]]\ntopic = '/a'\nagent = '{x}'\ntask = 't'", "expected placeholders of the topic"),
        ("[[action]]\ntopic = '/a'\nagent = 'r'\ntask = { field = '' }", "expected a field such as"),
        ("[[signal]]\ntopic = '/a'\nname = 's'\nfactor = 'x'", "factor: found 'x', expected a number"),
        ("[[safety]]\ntopic = '/a'\nagent = 'r'", "found neither mode nor speed"),
        (
            "[[safety]]\ntopic = '/a'\nagent = 'r'\nspeed = 'data'",
            "unit: found nothing, expected one of percent, fraction",
        ),
        (
            "[[task]]\ntopic = '/a'\nagent = 'r'\ntask = 't'\nstate = { field = 's' }",
            "without values that mean started",
        ),
        (
            "[[task]]\ntopic = '/a'\nagent = 'r'\ntask = 't'\nstate = { field = 's' }\nstarted = [1]\nfailed = ['1']",
            "found '1', which is started too",
        ),
        ("[[plansys2]]\n[run]\nby = 'gaps'", "run: by: found 'gaps', expected one of recording, topic, gap"),
        ("[[plansys2]]\n[run]\nby = 'topic'\ntopic = '/r'", "expected a field for one of them"),
        ("[[plansys2]]\n[run]\ngap_s = 3", 'expected by = "gap" beside it'),
    ],
)
def test_what_has_no_meaning_is_told(text: str, problem: str) -> None:
    with pytest.raises(MappingError, match=problem):
        cell(text)


def test_all_problems_are_told_at_once() -> None:
    with pytest.raises(MappingError) as caught:
        cell("[[action]]\ntopic = 3\n[[signal]]\ntopic = '/s'\n[[bogus]]")
    assert len(caught.value.problems) == 5


@pytest.mark.parametrize("content", [b"\xff\xfe", b"a = ", b"[" * 5000, b"#" * (1 << 21)])
def test_what_is_no_toml_is_told(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "cell.toml"
    path.write_bytes(content)
    with pytest.raises(MappingError, match=r"cell\.toml: found"):
        read_mapping(path)
    with pytest.raises(MappingError, match="--suggest"):
        read_mapping(tmp_path / "other.toml")


TYPES = st.sampled_from(
    [
        "action_msgs/msg/GoalStatusArray",
        "actionlib_msgs/msg/GoalStatusArray",
        "x/msg/GoActionGoal",
        "sensor_msgs/msg/JointState",
        "std_msgs/msg/Float64",
        "plansys2_msgs/msg/ActionExecutionInfo",
        "ur_dashboard_msgs/msg/SafetyMode",
    ]
)
ENDS = st.sampled_from(["", "/_action/status", "/status", "/goal", "/speed_scaling"])


@settings(max_examples=many(40, fuzz=1000))
@given(st.dictionaries(st.tuples(st.builds("/{}{}".format, st.text(), ENDS), TYPES | st.text()), st.integers(0, 9)))
def test_a_suggestion_is_a_mapping_for_any_topics(topics: dict[tuple[str, str], int]) -> None:
    text = suggestion(topics, {})
    assert text.isprintable() or set(text) - {"\n"} == {c for c in text if c.isprintable()}
    content = tomllib.loads(text)
    known = {topic for topic, _ in topics}
    for tables in content.values():
        for table in tables:
            assert any(topic.startswith(table["topic"]) for topic in known)
    if content and not any(set(topic) & set("{}*") for topic in known):
        cell(text)


def test_the_page_lists_all_that_topics_may_mean() -> None:
    page = PAGE.read_text(encoding="utf-8")
    for kind, meaning in MEANINGS.items():
        assert f"| `[[{kind}]]` | {meaning.summary} |" in page


def test_the_tables_of_the_page_are_mappings() -> None:
    blocks = PAGE.read_text(encoding="utf-8").split("```toml\n")[1:]
    tables = [block.split("```")[0] for block in blocks]
    for text in tables:
        if text.startswith("[["):
            cell(text)
    assert sum(text.startswith("[[") for text in tables) == 4
