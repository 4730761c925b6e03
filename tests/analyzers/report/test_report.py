"""What a report says, which runs it shows, and that names in logs are never markup."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from random import Random
from types import SimpleNamespace
from typing import Any

import polars as pl
import pytest
from event_frames import event, frame
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.analyzers.analysis import analyze, analyze_logs
from hrclog.analyzers.figures.plot import Axis, Page, Plot, Steps
from hrclog.analyzers.figures.table import DataTable
from hrclog.analyzers.projections.schemas import DURATIONS, RUNS, SIGNALS, SYNERGIES
from hrclog.analyzers.report import save_report
from hrclog.analyzers.report.chance import holm, p_value
from hrclog.analyzers.report.document import report
from hrclog.analyzers.report.figure_files import figure_names, report_plots
from hrclog.analyzers.report.findings import findings
from hrclog.analyzers.report.methods import events_digest
from hrclog.analyzers.report.render import render
from hrclog.analyzers.report.sample import choose_runs, sample_sentence
from hrclog.analyzers.report.tables import KEPT, SHOWN, page_table
from hrclog.analyzers.result import Analysis
from hrclog.diagnostic import Diagnostic
from hrclog.errors import HrclogError, OutputError
from hrclog.file_names import file_stem
from hrclog.log.logs import Logs

S = 1_000_000_000
SAMPLES = Path(__file__).parents[3] / "sample_logs"

NASTY = (
    "<script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "' onmouseover='alert(1)",
    "</script><!--",
    "</template></title></style>",
    "{{ 7 * 7 }}{% raw %}",
    "$\\frac{1}{2}$ _a_b_ & &amp; &lt;",
    "=HYPERLINK(1)",
    "\u202eright to left\u0000\u001b[31m",
    "Größe 箱 📦 e\u0301",
    "x" * 200,
    "a b " * 50,
    " ",
)


def analysis_of(names: Sequence[str], *, title: str = "run") -> Analysis:
    """Return the analysis of two runs of two agents, named by four names: agents, then their tasks."""
    rows = []
    for number in range(2):
        run, start = f"r{number}", number * 100 * S
        rows.append(event("run_started", start, run_id=run, details=json.dumps({"name": title})))
        for side in range(2):
            execution = {"run_id": run, "agent": names[side], "task": names[2 + side], "execution_id": f"e{side}"}
            rows.append(event("task_started", start + side * S, **execution))
            outcome = {"outcome": "failed" if number and side else "succeeded", "reason": names[3]}
            rows.append(event("task_ended", start + (5 + number + side) * S, **execution, **outcome))
        rows.append(event("run_ended", start + 20 * S, run_id=run, outcome="succeeded"))
    rows.sort(key=lambda row: row["time_ns"])
    return analyze_logs(Logs(frame(rows), pl.DataFrame(schema=SIGNALS), [], []))


def stub(_plot: Plot) -> str:
    return '<svg width="10" height="10"></svg>'


class Tags(HTMLParser):
    """Tags, attributes and texts of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.texts: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keep a tag and its attributes."""
        self.tags.append(tag)
        self.attributes += attrs

    def handle_data(self, data: str) -> None:
        """Keep a text."""
        self.texts.append(data)


def runs_frame(rows: Sequence[tuple[str, float | None, int]]) -> pl.DataFrame:
    """Return runs as (id, makespan, failures)."""
    empty: dict[str, Any] = dict.fromkeys(RUNS)
    return pl.DataFrame(
        [
            empty | {"run_id": run, "name": run, "makespan_s": makespan, "n_failed": failed, "start_ns": 0}
            for run, makespan, failed in rows
        ],
        schema=RUNS,
        orient="row",
    )


SOME_RUNS = st.lists(st.tuples(st.one_of(st.none(), st.integers(1, 9).map(float)), st.integers(0, 3)), max_size=12).map(
    lambda rows: [(f"r{place}", makespan, failed if makespan else 0) for place, (makespan, failed) in enumerate(rows)]
)


@given(SOME_RUNS, st.integers(0, 14), st.randoms(use_true_random=False))
def test_the_runs_that_are_shown_span_all_and_hold_the_one_with_most_failures(
    rows: list[tuple[str, float | None, int]], count: int, random: Random
) -> None:
    chosen = choose_runs(runs_frame(rows), count)
    ids = [run.run_id for run in chosen]
    assert len(set(ids)) == len(ids) == min(count, len(rows))
    makespans = {run: makespan for run, makespan, _ in rows}
    shown = [makespans[run] for run in ids]
    timed = [makespan for makespan in shown if makespan is not None]
    assert timed == sorted(timed)
    assert shown == timed + [None] * (len(shown) - len(timed))
    known = [makespan for makespan in makespans.values() if makespan is not None]
    failures = {run: failed for run, _, failed in rows}
    most = max(failures.values(), default=0)
    if most and count:
        assert max(failures[run] for run in ids) == most
    if known and count >= 2 + bool(most):
        assert (timed[0], timed[-1]) == (min(known), max(known))
    shuffled = list(rows)
    random.shuffle(shuffled)
    assert choose_runs(runs_frame(shuffled), count) == chosen


def test_the_report_says_how_many_runs_of_how_many_it_shows_and_why_these() -> None:
    rows = [(f"r{place:02}", 90.0 + place, 3 if place == 7 else place == 8) for place in range(51)]
    chosen = choose_runs(runs_frame(rows), 4)
    assert [(run.run_id, run.why) for run in chosen] == [
        ("r00", "shortest"),
        ("r07", "longer than 14 % of the others, most failures (3)"),
        ("r25", "longer than 50 % of the others"),
        ("r50", "longest"),
    ]
    sentence = sample_sentence(chosen, 51)
    assert sentence.startswith("4 of 51 runs are shown, shortest first: shortest; longer than 14 %")
    assert "--runs N shows more" in sentence
    assert sample_sentence(choose_runs(runs_frame(rows), 60), 51) == "All 51 runs are shown, shortest first."
    assert "None of 51" in sample_sentence((), 51)
    assert [run.why for run in choose_runs(runs_frame([("a", 2.0, 1)]), 4)] == [
        "the only one with executions, most failures (1)"
    ]


@pytest.mark.parametrize(
    ("makespans", "expected"),
    [
        ((5.0, 5.0, 5.0), ["as long as all others"] * 3),
        ((1.0, 1.0, 2.0, 2.0), ["among the shortest"] * 2 + ["among the longest"] * 2),
        ((1.0, 2.0, 2.0, 3.0), ["shortest", *["longer than 33 % of the others"] * 2, "longest"]),
    ],
)
def test_runs_that_took_equally_long_are_spoken_of_alike(makespans: Sequence[float], expected: list[str]) -> None:
    chosen = choose_runs(runs_frame([(f"r{place}", makespan, 0) for place, makespan in enumerate(makespans)]), 9)
    assert [run.why for run in chosen] == expected


def synergies(rows: Sequence[tuple[str, float | None, float | None, float | None, int, str]]) -> pl.DataFrame:
    """Return synergies as (task, synergy, low, high, n, status) of a robot beside a human."""
    empty: dict[str, Any] = dict.fromkeys(SYNERGIES)
    names = ("task", "synergy", "ci_low", "ci_high", "n", "status")
    return pl.DataFrame(
        [
            empty
            | {"agent": "robot", "other_agent": "human", "other_task": "hold", "estimator": "aft"}
            | dict(zip(names, row, strict=True))
            for row in rows
        ],
        schema=SYNERGIES,
        orient="row",
    )


FREE = ("synergy_free", "free_ci_low", "free_ci_high")


def relative_to_undisturbed(table: pl.DataFrame) -> pl.DataFrame:
    """Return synergies whose factors are those over undisturbed work; over the mean they say the contrary."""
    names = ("synergy", "ci_low", "ci_high")
    free = (pl.col(name).alias(other) for name, other in zip(names, FREE, strict=True))
    mean = (1 / pl.col("synergy"), 1 / pl.col("ci_high"), 1 / pl.col("ci_low"))
    return table.with_columns(*free, *(one.alias(name) for one, name in zip(mean, names, strict=True)))


def took(least: float, mean: float, most: float) -> pl.DataFrame:
    """Return durations of robot: pick."""
    row = dict.fromkeys(DURATIONS, 0) | {"agent": "robot", "task": "pick", "count": 5}
    return pl.DataFrame([row | {"min_s": least, "mean_s": mean, "max_s": most}], schema=DURATIONS)


def said(table: pl.DataFrame, durations: pl.DataFrame | None = None, estimator: str = "aft") -> list[str]:
    """Return all sentences of the findings."""
    known = {"runs": runs_frame([]), "events": frame([]), "diagnostics": [], "estimator": estimator}
    known["durations"] = pl.DataFrame(schema=DURATIONS) if durations is None else durations
    found = findings(SimpleNamespace(synergies=table, **known))  # type: ignore[arg-type]  # all that the function asks for
    return [text for finding in found for text in (finding.text, *finding.details)]


SOME_FACTORS = (
    ("pick", 3.48, 1.89, 6.41, 7, "ok"),
    ("wait", 9.0, 1.01, 80.0, 2, "sparse"),
    ("put", 1.1, 0.9, 1.3, 9, "ok"),
    ("go", 0.8, 0.7, 0.9, 12, "ok"),
    ("look", None, None, None, 0, "unobserved"),
    ("turn", None, None, None, 3, "weakly_identified"),
)


def test_findings_compare_with_undisturbed_work_what_remains_among_many_first() -> None:
    slow = "times as long as undisturbed while human: hold runs"
    late = ("late", 20.0, 1.5, 266.0, 2, "ok")  # its interval is farther from 1 than that of what remains
    assert said(relative_to_undisturbed(synergies([late, ("first", 1.4, 1.3, 1.5, 9, "ok"), *SOME_FACTORS]))) == [
        "4 slow-downs whose 95 % interval lies above 1, clearest first:",
        f"robot: pick takes 3.48 [1.89, 6.41] {slow} (n = 7).",
        f"robot: first takes 1.40 [1.30, 1.50] {slow} (n = 9).",
        f"robot: late takes 20.00 [1.50, 266.00] {slow} (n = 2, not after allowing for 6 comparisons).",
        f"robot: wait takes 9.00 [1.01, 80.00] {slow} (n = 2, few successes, not after allowing for 6 comparisons).",
        "1 speed-up whose 95 % interval lies below 1, clearest first:",
        f"robot: go takes 0.80 [0.70, 0.90] {slow} (n = 12).",
        "Of 6 intervals of 95 %, 5 show a slow-down or a speed-up; after allowing for 6 comparisons (Holm), 3 remain.",
        "1 of 8 ordered pairs of tasks never overlapped: nothing is known of them.",
        "1 pair of tasks overlapped, but the data do not tell a factor.",
    ]


def test_findings_name_what_overlapped_and_never_succeeded() -> None:
    table = synergies([*SOME_FACTORS[:1], *[(f"t{n}", None, None, None, 24, "no_success") for n in range(4)]])
    table = table.with_columns(pl.when(task="t3").then(9.0).otherwise(1.0).alias("overlap_s"))
    assert said(table)[-5:] == [
        "4 pairs of tasks overlapped, but the first never succeeded then, so that no factor is told:",
        "robot: t3 while human: hold runs (n = 24, 9.0 s).",
        "robot: t0 while human: hold runs (n = 24, 1.0 s).",
        "robot: t1 while human: hold runs (n = 24, 1.0 s).",
        "1 more in the table of synergies.",
    ]
    assert not any("never overlapped" in sentence for sentence in said(table))


def test_relative_to_the_mean_there_are_slow_downs_and_no_speed_ups() -> None:
    assert said(synergies(SOME_FACTORS[:4])) == [
        "2 slow-downs whose 95 % interval lies above 1, clearest first:",
        "robot: pick takes 3.48 [1.89, 6.41] times its mean while human: hold runs (n = 7).",
        (
            "robot: wait takes 9.00 [1.01, 80.00] times its mean while human: hold runs (n = 2, few successes, "
            "not after allowing for 4 comparisons)."
        ),
        "Of 4 intervals of 95 %, 2 show a slow-down or a speed-up; after allowing for 4 comparisons (Holm), 1 remains.",
        (
            "1 factor relative to the mean lies below 1, which undisturbed pairs do too when others slow the task "
            "down; undisturbed work was not seen enough to tell."
        ),
    ]
    assert said(synergies(SOME_FACTORS[3:4]))[0] == "No slow-down and no speed-up is certain."


def test_one_overwhelming_effect_of_two_is_no_chance_and_a_faint_one_among_many_is() -> None:
    strong = said(synergies([("pick", 1.34, 1.31, 1.37, 20, "ok"), ("put", 1.0, 0.9, 1.1, 9, "ok")]))
    assert strong[-1].endswith("after allowing for 2 comparisons (Holm), 1 remains.")
    faint = said(synergies([("pick", 1.5, 1.01, 2.23, 7, "ok"), *([("put", 1.0, 0.9, 1.1, 9, "ok")] * 17)]))
    assert faint[-1].endswith("1 shows a slow-down or a speed-up; after allowing for 18 comparisons (Holm), 0 remain.")


def test_findings_say_plainly_that_nothing_is_certain() -> None:
    [sentence] = said(synergies([("pick", 1.5, 0.9, 2.5, 7, "ok")]))
    assert sentence == "No slow-down and no speed-up is certain: the interval includes 1."
    assert said(synergies([])) == [
        "No two agents have tasks to compare, so nothing is said of how they affect each other."
    ]
    assert said(synergies([("pick", 1.5, None, None, 7, "ok")])) == [
        "No factor has an interval, so no slow-down is certain."
    ]


def test_a_factor_beyond_all_that_was_seen_is_said_to_be_one_of_parts() -> None:
    beyond = "; no execution was that long: the factor is that of the part that overlapped"
    mean = synergies([("pick", 4.5, 2.0, 9.0, 7, "ok")])
    free = relative_to_undisturbed(mean)
    assert said(free, took(2.0, 3.0, 10.0))[1].endswith("(n = 7).")  # 10 is 5 times 2
    assert said(mean, took(2.0, 3.0, 10.0))[1].endswith(f"(n = 7){beyond}.")
    assert said(free, took(2.5, 3.0, 10.0))[1].endswith(f"(n = 7){beyond}.")
    still = synergies([("pick", 34.66, 9.0, 140.0, 7, "ok")])
    assert said(still, took(2.0, 3.0, 10.0))[1].endswith(f"(n = 7){beyond}, which nearly stood still.")


def test_factors_that_no_duration_can_have_are_counted_and_not_named() -> None:
    table = synergies([("pick", -1.5, -2.0, -1.0, 7, "ok"), ("put", 0.0, -0.1, 0.1, 9, "ok")])
    sentences = said(table)
    assert sentences == [
        "No slow-down and no speed-up is certain.",
        (
            "2 factors are at or below 0, which no duration can be: the data do not support a factor there, so nothing "
            "is said of it."
        ),
    ]
    assert not any("robot: p" in sentence for sentence in sentences)


def test_findings_say_what_is_wrong_with_the_factors_of_an_estimator() -> None:
    table = synergies(SOME_FACTORS[:1])
    assert any("should not be planned with" in sentence for sentence in said(table, estimator="paper"))
    assert any("a third too small" in sentence for sentence in said(table, estimator="ols"))
    assert not any("planned with" in sentence or "too small" in sentence for sentence in said(table))


def test_p_values_are_those_of_a_normal_log_factor_and_linear_where_it_has_no_log() -> None:
    assert p_value(1.5, 1.0, 2.25) == pytest.approx(0.05, abs=1e-6)
    assert p_value(1 / 1.5, 1 / 2.25, 1.0) == pytest.approx(0.05, abs=1e-6)
    assert p_value(2.0, -1.0, 5.0) == pytest.approx(0.5135, abs=1e-4)  # z = 1 / (6 / 3.92)
    assert p_value(1.0, 0.5, 2.0) == 1.0
    assert (p_value(1.0, 1.0, 1.0), p_value(2.0, 2.0, 2.0)) == (1.0, 0.0)


def test_holm_allows_for_how_many_there_are() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.8]) == [1.0, 1.0]
    assert holm([]) == []


def makespan_said(runs: Sequence[tuple[float, str, int, str]]) -> list[str]:
    """Return what findings say of the makespans of runs: (makespan, outcome, open executions, planner)."""
    table = runs_frame([(f"r{place}", makespan, 0) for place, (makespan, *_) in enumerate(runs)]).with_columns(
        pl.Series("outcome", [run[1] for run in runs]), pl.Series("n_open", [run[2] for run in runs])
    )
    started = [
        event("run_started", 0, run_id=f"r{place}", details=json.dumps({"planner": run[3]}))
        for place, run in enumerate(runs)
    ]
    known = {"durations": pl.DataFrame(schema=DURATIONS), "synergies": synergies([]), "diagnostics": []}
    found = findings(SimpleNamespace(runs=table, events=frame(started), estimator="aft", **known))  # type: ignore[arg-type]  # all that the function asks for
    return [text for finding in found for text in (finding.text, *finding.details) if "No two agents" not in text]


def test_makespans_of_runs_that_were_cut_short_are_left_out_and_counted() -> None:
    good = [(20.0, "succeeded", 0, ""), (22.0, "", 0, "")]
    spoken = "Makespan: mean 21.0 s ± 1.4 s (sample standard deviation, n = 2), from 20.0 to 22.0 s"
    assert makespan_said(good) == [f"{spoken}."]
    cut = [(1.0, "failed", 0, ""), (2.0, "canceled", 0, ""), (3.0, "", 1, "")]
    assert makespan_said([*good, *cut]) == [f"{spoken} (2 of 5 runs, those that ended well)."]
    assert makespan_said(cut) == ["Makespan: none of 3 runs ended well, so none is told."]
    one = [(20.0, "succeeded", 0, "")]
    assert makespan_said([*one, *cut[:1]]) == ["Makespan: 20.0 s (n = 1) (1 of 2 runs, those that ended well)."]


def test_makespans_of_several_planners_are_told_apart() -> None:
    runs = [(20.0, "", 0, "fast"), (22.0, "", 0, "fast"), (40.0, "", 0, "slow"), (1.0, "failed", 0, "slow")]
    assert makespan_said(runs) == [
        "Makespan by planner, mean ± sample standard deviation (3 of 4 runs, those that ended well):",
        "fast: 21.0 s ± 1.4 s (n = 2).",
        "slow: 40.0 s (n = 1).",
    ]
    many = makespan_said([(float(place), "", 0, f"p{place}") for place in range(7)])
    assert len(many) == 7
    assert many[-1] == "2 more in the figure of makespans."


def test_that_everything_succeeded_is_said_with_a_doubt_where_there_were_many() -> None:
    analysis = replace(analysis_of(list("ABcd")), durations=took(1.0, 2.0, 3.0))
    assert findings(replace(analysis, diagnostics=[]))[-1].text == "All 5 executions of main tasks succeeded."
    assert findings(replace(analysis, diagnostics=[Diagnostic("single_outcome", "all")]))[-1].text == (
        "All 5 executions of main tasks succeeded: failures may have been removed before we saw them."
    )
    alone = analysis.durations.with_columns(count=pl.lit(1, pl.Int64))
    found = findings(replace(analysis, durations=alone, diagnostics=[]))
    assert found[-1].text == "The only execution of a main task succeeded."


def test_findings_put_lost_data_first_and_count_failures_with_their_intervals() -> None:
    lost = [Diagnostic("truncated", "cut"), Diagnostic("single_outcome", "all")]
    found = findings(replace(analysis_of(["<b>", "r", "pick", "put"]), diagnostics=lost))
    assert found[0].text == "Data was lost or skipped (1 error, see Diagnostics)."
    assert found[0].kind == "lost"
    assert found[1].text == "Makespan: mean 6.5 s ± 0.7 s (sample standard deviation, n = 2), from 6.0 to 7.0 s."
    assert found[-1].text == "Of 4 executions of main tasks 1 failed or timed out; success least often:"
    assert found[-1].details == ("r: put succeeded in 1 of 2 (50 % [9 %, 91 %]).",)


@cache
def page_of(*names: str) -> Tags:
    """Return the page about agents and tasks of four names, under a fifth."""
    said = report(analysis_of(names[:4], title=names[4]), title=names[4], command=names[4])
    return Tags(render(said, stub))


@settings(max_examples=12)
@given(st.lists(st.one_of(st.sampled_from(NASTY), st.text(min_size=1, max_size=30)), min_size=5, max_size=5))
def test_names_change_texts_and_never_the_structure_of_the_page(names: list[str]) -> None:
    names = [name.encode(errors="replace").decode() for name in names]
    names[1] += "2" if names[0] == names[1] else ""
    found, expected = page_of(*names), page_of("A", "B", "pick", "put", "title")
    for tag in ("script", "style", "img", "template", "td", "li", "figure", "h3"):
        assert found.tags.count(tag) == expected.tags.count(tag), tag
    assert {name for name, _ in found.attributes} == {name for name, _ in expected.attributes} | {"title", "data-value"}
    assert set(found.tags) == set(expected.tags) | {"wbr"}


def test_a_table_shows_short_numbers_and_keeps_full_ones() -> None:
    frame = pl.DataFrame(
        {"path": ["/" + "long/" * 20], "x_s": [1 / 3], "n": [1234], "none": [None], "list": [["a", "b"]]}
    )
    table = page_table(DataTable("t", "T", frame.cast({"none": pl.Float64})), "t")
    assert [column.name for column in table.columns] == ["x_s", "n", "none", "list", "path"]
    assert [column.numeric for column in table.columns] == [True, True, True, False, False]
    [row] = table.rows
    assert [cell.text for cell in row[:4]] == ["0.333", "1234", "n/a", "a, b"]
    assert [cell.value for cell in row[:4]] == [repr(1 / 3), None, "", None]
    assert len(row[4].text) == 40
    assert row[4].value == "/" + "long/" * 20
    assert not table.filterable
    assert table.notes == ()


def test_numbers_of_a_column_have_equally_many_decimals_unless_they_are_too_far_apart() -> None:
    frame = pl.DataFrame({"x_s": [1.5, 1234.5, 0.0, None, float("nan")], "y": [1e-9, 1.5, 2.0, 300.0, None]})
    rows = page_table(DataTable("t", "T", frame), "t").rows
    assert [row[0].text for row in rows] == ["1.500", "1,234.500", "0.000", "n/a", "n/a"]
    assert [row[0].value for row in rows] == ["1.5", "1234.5", "0.0", "", ""]
    assert [row[1].text for row in rows] == ["1.00e-09", "1.500", "2.000", "300.0", "n/a"]


def test_of_too_many_synergies_those_with_a_factor_are_kept_and_come_first() -> None:
    factors = [float(place) if place % 50 == 49 else None for place in range(KEPT + 50)]
    table = synergies([(f"t{place:05}", factor, None, None, 1, "ok") for place, factor in enumerate(factors)])
    found = page_table(DataTable("synergies", "S", table), "t")
    column = table.columns.index("task")
    tasks = [row[column].text for row in (*found.rows, *found.more)]
    known = [f"t{place:05}" for place, factor in enumerate(factors) if factor is not None]
    assert tasks[: len(known)] == known
    assert len(tasks) == SHOWN
    assert found.notes == (
        "This page holds the first 200 of 5,050 rows, 101 of the 101 with a factor first; hrclog export writes all.",
    )
    few = page_table(DataTable("synergies", "S", table.head(100)), "t")
    assert [row[column].text for row in few.rows[:3]] == ["t00049", "t00099", "t00000"]


@pytest.mark.parametrize("height", [0, 1, 21, SHOWN, SHOWN + 1, KEPT, KEPT + 1])
def test_a_long_table_shows_its_beginning_and_says_how_long_it_is(height: int) -> None:
    table = page_table(DataTable("t", "T", pl.DataFrame({"n": range(height)})), "t")
    assert len(table.rows) == min(height, SHOWN)
    assert len(table.rows) + len(table.more) == min(height, KEPT)
    assert any(f"of {height:,} rows" in note for note in table.notes) == (height > SHOWN)
    assert any("holds the first" in note for note in table.notes) == (height > KEPT)
    assert table.filterable == (height > 20)


def test_a_page_of_a_long_table_holds_all_its_rows_but_shows_the_first() -> None:
    said = report(analysis_of(["A", "B", "pick", "put"]), runs=0)
    long = page_table(DataTable("t", "T", pl.DataFrame({"n": range(SHOWN + 7)})), "t")
    page = render(replace(said, tables=(long,)), stub)
    shown, hidden = page.split("<template>")
    assert f'<td class="num">{SHOWN - 1}</td>' in shown
    assert hidden.split("</template>")[0].count("<tr>") == 7


def test_ids_are_unique_and_links_lead_somewhere() -> None:
    page = Tags(render(report(analysis_of(["A", "B", "pick", "put"]), runs=2), stub))
    ids = [value for name, value in page.attributes if name == "id"]
    assert len(set(ids)) == len(ids)
    for name, value in page.attributes:
        if name == "href" and value != "data:,":
            assert value[1:] in ids
        if name == "aria-labelledby":
            assert value in ids


def test_headings_go_down_one_level_at_a_time() -> None:
    page = Tags(render(report(analysis_of(["A", "B", "pick", "put"]), runs=2), stub))
    levels = [int(tag[1]) for tag in page.tags if re.fullmatch(r"h[1-6]", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(level <= before + 1 for before, level in pairwise(levels))


def test_the_script_is_the_one_that_the_policy_allows_and_nothing_is_asked_for() -> None:
    page = render(report(analysis_of(list(NASTY[:4]))), stub)
    [script] = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in page
    assert "default-src 'none'" in page
    addresses = [value for name, value in Tags(page).attributes if name in ("src", "href", "action", "srcset")]
    assert [value for value in addresses if not value.startswith("#")] == ["data:,"]
    assert "@import" not in page
    assert "url(" not in page


def plot(*path: str, title: str = "title") -> Plot:
    return Plot(path, title, "reading", Axis(0, 1), Axis(0, 1))


@given(st.lists(st.lists(st.one_of(st.sampled_from(NASTY), st.text(max_size=9)), max_size=3), max_size=6))
def test_every_figure_gets_a_file_of_its_own_in_the_folder(paths: list[list[str]]) -> None:
    names = figure_names([plot(*path) for path in paths])
    assert len({name.casefold() for name in names}) == len(paths)
    for name in names:
        assert name
        assert name == file_stem(name, 200)
        assert len(f"{name}.png".encode()) <= 255


def test_figures_in_files_carry_their_number_and_their_run() -> None:
    said = report(analysis_of(["A", "B", "pick", "put"], title="monday"), runs=1)
    titles = [one.title for one in report_plots(said)]
    assert [title.split(".")[0] for title in titles] == [f"Figure {number}" for number in range(1, len(titles) + 1)]
    assert f"Figure {len(titles)}. monday: Overlap so far (s)" == titles[-1]


def test_of_plots_that_grew_with_the_runs_the_last_is_shown_and_all_can_be_stepped_through() -> None:
    stages = Steps("grown", (1, 2, 5), tuple(plot("grown", title=f"after {number}") for number in (1, 2, 5)))
    analysis = analysis_of(["A", "B", "pick", "put"])
    figures = analysis.campaign_figures()
    grown = SimpleNamespace(
        **{name: getattr(analysis, name) for name in analysis.__dataclass_fields__},
        campaign_figures=lambda: SimpleNamespace(
            pages=(Page("Convergence", (), (stages,)),), tables=figures.tables, captions=()
        ),
        run_figures=analysis.run_figures,
    )
    said = report(grown, runs=0)  # type: ignore[arg-type]  # all that the function asks for
    assert [one.plot.title for one in said.figures] == ["after 5"]
    page = render(said, lambda plot: f"<svg>{plot.title}</svg>")
    found = re.findall(r'<div class="stage" data-number="(\d)"( hidden)?>.*?<svg>(.*?)</svg>', page, re.DOTALL)
    assert found == [("1", " hidden", "after 1"), ("2", " hidden", "after 2"), ("5", "", "after 5")]


def test_the_digest_is_of_the_events_and_of_nothing_else() -> None:
    events = analysis_of(["A", "B", "pick", "put"]).events
    digest = events_digest(events)
    assert events_digest(events.reverse().with_columns(pl.lit("elsewhere.mcap").alias("path"))) == digest
    assert events_digest(events.with_columns(pl.col("time_ns") + 1)) != digest


def test_a_report_says_with_what_it_was_made() -> None:
    page = " ".join(Tags(render(report(analysis_of(list("ABcd")), command="hrclog report x"), stub)).texts)
    for text in ("hrclog report x", "SHA-256", "Python 3", "numpy", "scikit-learn", "aft: a rate model", "Wilson"):
        assert text in page


@pytest.mark.parametrize(("name", "value"), [("runs", -3), ("runs", "4"), ("title", 7), ("title", None)])
def test_what_is_no_title_and_no_count_of_runs_is_a_sentence(name: str, value: object, tmp_path: Path) -> None:
    with pytest.raises(HrclogError, match=f"{name} is {value!r}, expected"):
        analysis_of(list("ABcd")).to_report(tmp_path / "report.html", **{name: value})  # type: ignore[arg-type]  # all that the function asks for
    assert not list(tmp_path.iterdir())


def test_parts_of_pictures_have_names_of_their_own_though_the_pictures_be_the_same() -> None:
    same = (
        '<svg width="1"><path id="p0123456789-0"/><use href="#p0123456789-0"/><g clip-path="url(#p0123456789-0)">'
        "<title>p0123456789-0</title></g></svg>"
    )
    page = render(report(analysis_of(list("ABcd")), runs=1), lambda _: same)
    ids = re.findall(r'id="([^"]*p0123456789-0)"', page)
    assert len(ids) > 1
    assert len(set(ids)) == len(ids)
    assert re.findall(r'href="#([^"]*p0123456789-0)"', page) == ids
    assert re.findall(r"url\(#([^)]*p0123456789-0)\)", page) == ids
    assert page.count("<title>p0123456789-0</title>") == len(ids)


def test_runs_without_executions_are_no_report(tmp_path: Path) -> None:
    rows = [event("run_started", 0, run_id="r")]
    nothing = analyze_logs(Logs(frame(rows), pl.DataFrame(schema=SIGNALS), [], []))
    with pytest.raises(HrclogError, match="no agent did anything in 1 run, expected executions"):
        save_report(nothing, tmp_path / "report.html")
    assert not list(tmp_path.iterdir())


def test_a_report_that_cannot_be_written_is_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="cannot be made"):
        save_report(analysis_of(list("ABcd")), tmp_path / "file" / "report.html", runs=0)


@pytest.mark.slow
def test_the_same_runs_give_the_same_bytes_and_names_are_text_in_pictures_too(tmp_path: Path) -> None:
    analysis = analyze(SAMPLES / "three_agents.mcap")
    for name in ("a", "b"):
        save_report(analysis, tmp_path / f"{name}.html")
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()
    save_report(analysis_of(list(NASTY[:4]), title=NASTY[4]), tmp_path / "nasty.html")
    page = Tags((tmp_path / "nasty.html").read_text(encoding="utf-8"))
    assert page.tags.count("script") == 1
    assert "img" not in page.tags
    ids = [value for name, value in page.attributes if name == "id"]
    assert len(set(ids)) == len(ids)
    assert not [name for name, _ in page.attributes if name.startswith("on")]
