"""What a notebook shows of an analysis is small, whole HTML, whatever things are called."""

from __future__ import annotations

from html.parser import HTMLParser
from typing import Any

import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from interval_frames import frame, random_runs, row
from run_frames import runs_of

import hrclog
from hrclog.analyzers.analysis import analyze_logs
from hrclog.analyzers.notebook import headline, page
from hrclog.analyzers.projections.durations import durations
from hrclog.analyzers.projections.overlaps import overlaps
from hrclog.analyzers.projections.schemas import DURATIONS, RUNS, SYNERGIES
from hrclog.analyzers.synergy.estimator import estimate
from hrclog.analyzers.synergy.estimators import ESTIMATORS
from hrclog.analyzers.synergy.observations import observe
from hrclog.log.logs import Logs
from hrclog.log.messages.message import EVENTS
from hrclog.log.messages.signals import SIGNAL_COLUMNS

TAGS = {"div", "p", "b", "br", "code", "table", "caption", "tr", "th", "td", "span"}
HOSTILE = (
    "<script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "&lt;",
    "'",
    "\x1b[2J\n",
    "\ud800",
    "計" * 200,
    " ",
)


class Reader(HTMLParser):
    """Reads HTML: its elements, its attributes, its text, and whether all is closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.attributes: set[str] = set()
        self.text = ""
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note an element that opens, and its attributes."""
        assert tag in TAGS
        self.attributes |= {name for name, _ in attrs}
        self.open += [tag] if tag != "br" else []

    def handle_endtag(self, tag: str) -> None:
        """Note that the last element closes."""
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        """Keep a text."""
        self.text += data


def html_of(drawn: list[dict[str, Any]], **tags: str) -> str:
    intervals = frame(drawn)
    runs = runs_of(intervals).with_columns(pl.lit(value).alias(key) for key, value in tags.items())
    synergies = estimate(ESTIMATORS["ols"], observe(intervals), "none").synergies
    assert overlaps(intervals).height
    return page(runs, durations(intervals), synergies, [])


def test_a_notebook_shows_the_summary_and_the_heatmap_in_a_few_kilobytes() -> None:
    html = html_of(random_runs(1), condition="areas")
    text = Reader(html).text
    for shown in (
        "20 runs, 320 executions, 2 agents (H, R)",
        "tags: condition (1)",
        "mean s",
        "Synergy: H while R works",
    ):
        assert shown in text
    assert len(html.encode()) < 10_000


@settings(max_examples=10)
@given(st.tuples(*[st.sampled_from(HOSTILE)] * 3), st.tuples(*[st.sampled_from(HOSTILE)] * 2))
def test_names_are_texts_and_never_elements(agents: tuple[str, ...], tasks: tuple[str, ...]) -> None:
    named = dict(zip("HRX", (f"{number}{name}" for number, name in enumerate(agents)), strict=True))
    drawn = random_runs(2, n_runs=4, agents="HRX", tasks=2)
    renamed = [
        each | {"agent": named[each["agent"]].encode("utf-8", "replace").decode(),
                "task": f"{each['task']}{tasks[int(each['task'][1])]}".encode("utf-8", "replace").decode()}
        for each in drawn
    ]  # fmt: skip
    html = html_of(renamed, **{"<b>": "<i>"})
    assert Reader(html).attributes <= {"style", "title"}
    assert "\x1b" not in html


def test_many_agents_and_tasks_do_not_make_it_large() -> None:
    drawn = random_runs(3, n_runs=3, per_agent=20, agents="ABCDEF", tasks=15)
    html = html_of([each | {"task": each["task"] * 40, "agent": each["agent"] * 40} for each in drawn])
    assert len(html.encode()) < 50_000
    assert "more pairs of agents" in Reader(html).text


def test_nothing_is_shown_as_nothing() -> None:
    html = page(RUNS.to_frame(), DURATIONS.to_frame(), SYNERGIES.to_frame(), [])
    assert "0 runs, 0 executions, 0 agents" in Reader(html).text
    alone = Reader(html_of([row("A", "x", 0, 10), row("A", "y", 5, 20)]))
    assert "1 agent (A)" in alone.text
    assert headline(RUNS.to_frame(), []) == "0 runs, 0 executions, 0 agents"


def test_what_a_prompt_shows_is_one_line() -> None:
    nothing = Logs(EVENTS.to_frame(), SIGNAL_COLUMNS.to_frame(), [])
    assert repr(nothing) == "<hrclog.Logs: 0 runs, 0 events>"
    facts = {"agent": ["a\n", "b"], "task": ["x", "y"], "start": [0.0, 1.0], "end": [2.0, 3.0]}
    logs = hrclog.from_table(pl.DataFrame(facts))
    assert repr(logs) == "<hrclog.Logs: 1 run, 6 events, 1 diagnostic>"
    analysis = analyze_logs(logs)
    assert repr(analysis) == "<hrclog.Analysis: 1 run, 2 executions, 2 agents (a, b), 3 diagnostics>"
    Reader(analysis._repr_html_())


@pytest.mark.parametrize("estimator", ["aft", "paper"])
def test_an_analysis_of_no_event_is_shown(estimator: str) -> None:
    analysis = analyze_logs(Logs(EVENTS.to_frame(), SIGNAL_COLUMNS.to_frame(), []), estimator)
    Reader(analysis._repr_html_())
    assert analysis.executions.height == 0
