"""The figures: what is drawn is what was measured, and what is left out is said."""

from __future__ import annotations

import unicodedata
from collections.abc import Callable
from itertools import combinations
from typing import Any

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.analyzers.figures import Further, campaign_figures, run_figures
from hrclog.analyzers.figures.boxplot import MAX_BOXES, MAX_OUTLIERS, duration_boxes
from hrclog.analyzers.figures.boxplot_plot import boxplot_plot
from hrclog.analyzers.figures.campaign import MAX_AGENT_PAIRS
from hrclog.analyzers.figures.coefficients import MAX_ROWS, synergy_coefficients
from hrclog.analyzers.figures.coefficients_plot import coefficients_plot
from hrclog.analyzers.figures.events import event_lines, pauses
from hrclog.analyzers.figures.gantt import Bar, Lane, execution_lanes, limited, state_changes
from hrclog.analyzers.figures.gantt_plot import gantt_plot
from hrclog.analyzers.figures.heatmap import MAX_SIDE
from hrclog.analyzers.figures.heatmap_plot import heatmap_plot
from hrclog.analyzers.figures.lanes import lane_numbers
from hrclog.analyzers.figures.overlap_matrix import overlap_matrices
from hrclog.analyzers.figures.palette import FAILED, FULL_SPEED, PAUSED, REDUCED, TASKS, diverging, task_colors
from hrclog.analyzers.figures.plot import page_plots
from hrclog.analyzers.figures.run_plots import run_plots
from hrclog.analyzers.figures.series import overlaps_so_far, signal_series, speed_scales
from hrclog.analyzers.figures.synergy_heatmap import synergy_heatmaps
from hrclog.analyzers.figures.table import DataTable, markdown
from hrclog.analyzers.figures.text import UNNAMED, markdown_escape, printable, shorten
from hrclog.analyzers.projections.schemas import DURATIONS, INTERVALS, PAIR_OVERLAPS, RUNS, SETTLING, SIGNALS, SYNERGIES
from hrclog.diagnostic import Diagnostic
from hrclog.events import COLUMNS, FLOAT_COLUMNS, INT_COLUMNS

S = 1_000_000_000
INTS = {*INT_COLUMNS, "schema_version", "attempt", "seq"}
EVENTS = pl.Schema(
    {name: pl.Float64 if name in FLOAT_COLUMNS else pl.Int64 if name in INTS else pl.String for name in COLUMNS}
)
RUN = dict.fromkeys(RUNS, None) | {"run_id": "run", "name": "", "path": "", "agents": [], "outcome": ""}

spans = st.lists(st.tuples(st.integers(0, 60), st.integers(0, 20)).map(lambda pair: (pair[0], pair[0] + pair[1]))).map(
    sorted
)


def execution(agent: str, task: str, start: float, end: float | None, **fields: object) -> dict[str, Any]:
    """Return a row of INTERVALS; times in seconds, end None for an open one that the log saw until start + 1 s."""
    row = {name: "" if kind == pl.String else None for name, kind in INTERVALS.items()}
    row |= {
        "run_id": "run",
        "agent": agent,
        "task": task,
        "role": "primary",
        "execution_id": f"{agent}/{task}/{start}",
        "attempt": 1,
        "start_ns": round(start * S),
        "end_ns": None if end is None else round(end * S),
        "until_ns": round((start + 1 if end is None else end) * S),
        "outcome": "unknown" if end is None else "succeeded",
        "paused_ns": 0,
    }
    return row | fields


def frame(*rows: dict[str, Any]) -> pl.DataFrame:
    return pl.DataFrame(rows, schema=INTERVALS, orient="row") if rows else INTERVALS.to_frame()


def events(*rows: dict[str, Any]) -> pl.DataFrame:
    blank = {name: "" if kind == pl.String else None for name, kind in EVENTS.items()}
    return pl.DataFrame([blank | row for row in rows], schema=EVENTS, orient="row")


def cells(schema: pl.Schema, count: int, **columns: Callable[[int, int], object]) -> pl.DataFrame:
    """Return every ordered pair of `count` tasks of agents A and B; `columns` are functions of (row, column)."""
    rows = [
        {"agent": one, "task": f"t{i}", "other_agent": other, "other_task": f"t{j}", "estimator": "aft"}
        | {name: value(i, j) for name, value in columns.items()}
        for one, other in (("A", "B"), ("B", "A"))
        for i in range(count)
        for j in range(count)
    ]
    return pl.DataFrame([{name: row.get(name) for name in schema} for row in rows], schema=schema, orient="row")


def test_a_label_is_short_printable_and_never_empty() -> None:
    for text in ("", "\n", "pick", "a" * 90, "R\u202eö\x00", "机器人", "  spaced \t out "):
        label = shorten(text, 20)
        assert 0 < len(label) <= 20
        assert all(unicodedata.category(char)[0] != "C" for char in label)
    assert shorten("pick_blue_box", 20) == "pick_blue_box"
    assert shorten("", 20) == UNNAMED
    assert shorten("place_blue_box_on_guide_17", 12) == "place_bl…_17"


@given(st.text(), st.integers(3, 40))
def test_a_shortened_label_keeps_both_ends(text: str, width: int) -> None:
    whole, label = printable(text), shorten(text, width)
    assert len(label) == min(len(whole), width)
    if len(whole) > width:
        head, _, tail = label.rpartition("…")
        assert whole.startswith(head)
        assert whole.endswith(tail)


def test_markdown_cells_show_names_as_they_are() -> None:
    table = DataTable(
        "t", "T", pl.DataFrame({"name": ["a|b *c* `d` <e>", "", "x\ny"], "value": [1.5, None, float("nan")]})
    )
    text = markdown(table, 10)
    assert r"| a\|b \*c\* \`d\` \<e\> | 1.500 |" in text
    assert "| x·y | n/a |" in text
    assert markdown_escape("") == ""


def test_a_long_table_says_how_much_it_shows() -> None:
    text = markdown(DataTable("t", "T", pl.DataFrame({"n": range(250)})), 100)
    assert "The first 100 of 250 rows" in text
    assert text.count("\n| ") == 100 + 1


@given(spans)
def test_lanes_hold_no_collision_and_are_as_few_as_possible(found: list[tuple[int, int]]) -> None:
    rows = lane_numbers(found)
    for (one, row), (other, other_row) in combinations(zip(found, rows, strict=True), 2):
        if row == other_row and one[1] > one[0] and other[1] > other[0]:
            assert min(one[1], other[1]) <= max(one[0], other[0])
    depth = max((sum(start <= at < end for start, end in found) for at, _ in found), default=0)
    assert len({row for row, (start, end) in zip(rows, found, strict=True) if end > start}) <= max(depth, 1)


@given(spans)
def test_state_changes_give_the_bars_back(found: list[tuple[int, int]]) -> None:
    row = lane_numbers(found)
    own = [span for span, number in zip(found, row, strict=True) if number == 0]
    lane = Lane("A", "done", 0, tuple(Bar(start, end, "same", (0, 0, 0)) for start, end in own))
    instants, states = state_changes(lane)
    assert instants == sorted(instants)
    assert states == ["same", ""] * (len(states) // 2)
    assert list(zip(instants[::2], instants[1::2], strict=True)) == [span for span in own if span[1] > span[0]]


def test_ten_tasks_have_ten_colours_and_keep_them_in_another_run() -> None:
    names = [f"task {index}" for index in range(len(TASKS))]
    assert len(set(task_colors(names).values())) == len(TASKS)
    assert task_colors(["pick", "place"])["pick"] == task_colors(["pick"])["pick"]
    assert set(task_colors([f"t{index}" for index in range(99)]).values()) == set(TASKS)


def test_the_diverging_scale_is_neutral_at_its_centre_and_clipped_at_its_ends() -> None:
    assert len(set(diverging(0.0))) == 1
    blue, orange = diverging(-1.0), diverging(1.0)
    assert blue[2] > blue[0]
    assert orange[0] > orange[2]
    assert diverging(7.0) == orange


def test_failures_retries_pauses_and_open_ends_can_be_told_apart() -> None:
    rows = frame(
        execution("R", "pick", 0, 10, outcome="failed"),
        execution("R", "pick", 10, 20, attempt=2),
        execution("R", "place", 20, 30, execution_id="paused"),
        execution("R", "weld", 30, None),
    )
    (lane,) = execution_lanes(rows, {"paused": [(23 * S, 25 * S, "safety")]}, 0)
    assert [bar.label for bar in lane.bars] == [
        "✗ pick failed",
        "#2 pick",
        "place",
        "|| place paused: safety",
        "place",
        "weld still open",
    ]
    assert [(bar.start_ns // S, bar.end_ns // S) for bar in lane.bars] == [
        (0, 10),
        (10, 20),
        (20, 23),
        (23, 25),
        (25, 30),
        (30, 31),
    ]
    assert lane.bars[0].color == FAILED
    assert lane.bars[3].color == PAUSED


def test_pauses_are_paired_and_one_that_never_ends_lasts_to_the_end() -> None:
    log = events(
        {"kind": "task_paused", "execution_id": "a", "time_ns": 1, "cause": "safety"},
        {"kind": "task_paused", "execution_id": "a", "time_ns": 2, "cause": "operator"},
        {"kind": "task_resumed", "execution_id": "a", "time_ns": 3},
        {"kind": "task_paused", "execution_id": "a", "time_ns": 5, "cause": "operator"},
        {"kind": "task_ended", "execution_id": "a", "time_ns": 6},
        {"kind": "task_paused", "execution_id": "b", "time_ns": 7, "cause": "dependency"},
    )
    assert pauses(log, 9) == {"a": [(1, 3, "safety"), (5, 6, "operator")], "b": [(7, 9, "dependency")]}


def test_what_an_agent_does_at_once_gets_a_lane_of_its_own() -> None:
    rows = frame(execution("H", "hold", 0, 10), execution("H", "screw", 2, 5), execution("H", "wipe", 5, 6))
    lanes = execution_lanes(rows, {}, 0)
    assert [(lane.number, [bar.label for bar in lane.bars]) for lane in lanes] == [
        (0, ["hold"]),
        (1, ["screw", "wipe"]),
    ]


def test_planned_times_share_a_lane_although_rounding_makes_them_overlap() -> None:
    rows = frame(
        execution("R", "pick", 0, 5, planned_start_ns=0, planned_end_ns=5 * S + 100),
        execution("R", "place", 5, 9, planned_start_ns=5 * S, planned_end_ns=9 * S),
        execution("R", "place", 9, 12, planned_start_ns=5 * S, planned_end_ns=9 * S, attempt=2),
    )
    planned = [lane for lane in execution_lanes(rows, {}, 0) if lane.kind == "planned"]
    assert [[(bar.start_ns, bar.end_ns) for bar in lane.bars] for lane in planned] == [[(0, 5 * S), (5 * S, 9 * S)]]


def test_lanes_beyond_the_limit_and_bars_without_length_are_said() -> None:
    lanes = [Lane(f"A{index}", "done", 0, (Bar(1, 1, "x", (0, 0, 0)),)) for index in range(5)]
    shown, captions = limited(lanes, 3)
    assert len(shown) == 3
    assert captions[0] == "The first 3 of 5 lanes are drawn."
    assert captions[1].startswith("3 executions without length")


def test_overlap_seconds_are_the_transpose_of_the_other_direction() -> None:
    pairs = cells(
        PAIR_OVERLAPS,
        3,
        overlap_s=lambda i, j: 10.0 * min(i, j) + max(i, j),
        n=lambda *_: 4,
        mean_ratio=lambda i, _: i / 10,
    )
    (seconds, ratio), (back, _) = overlap_matrices(pairs)
    assert (seconds.agents, back.agents) == (("A", "B"), ("B", "A"))
    np.testing.assert_array_equal(seconds.values, back.values.T)
    np.testing.assert_array_equal(ratio.values[2], [0.2, 0.2, 0.2])


def synergies(count: int) -> pl.DataFrame:
    """Return synergies of A and B; (0, 0) is unobserved, (1, 1) sparse."""
    seen = lambda value: lambda i, j: None if i == j == 0 else value(i, j)  # noqa: E731 - a function of functions
    return cells(
        SYNERGIES,
        count,
        synergy=seen(lambda i, j: 1 + (i - j) / 10),
        ci_low=seen(lambda i, j: 0.9 + (i - j) / 10),
        ci_high=seen(lambda i, j: 1.1 + (i - j) / 10),
        n=lambda i, j: 0 if i == j == 0 else 2 if i == j == 1 else 9,
        overlap_s=lambda i, j: float(i * count + j),
        status=lambda i, j: "unobserved" if i == j == 0 else "sparse" if i == j == 1 else "ok",
    )


def test_an_unobserved_pair_is_grey_and_has_no_number() -> None:
    heatmap = synergy_heatmaps(synergies(3))[0]
    assert np.isnan(heatmap.values[0, 0])
    assert heatmap.paint(heatmap.values[0, 0]) == "unobserved"
    assert heatmap.paint(1.0) == diverging(0.0)
    assert heatmap.doubtful is not None
    assert np.argwhere(heatmap.doubtful).tolist() == [[1, 1]]
    assert heatmap.low is not None
    assert heatmap.high is not None
    assert heatmap.high[1, 2] - heatmap.low[1, 2] == pytest.approx(0.2)
    assert any("never overlapped (1)" in text for text in heatmap.captions)


def test_a_pair_that_overlapped_without_a_success_says_so_in_cell_hover_and_notes() -> None:
    reason = lambda i, j: "no_success" if i == j == 0 else "weakly_identified" if i == j == 1 else "ok"  # noqa: E731 - used twice, just below
    table = cells(
        SYNERGIES,
        2,
        synergy=lambda i, j: None if i == j else 1.5,
        n=lambda *_: 24,
        overlap_s=lambda *_: 195.3,
        status=reason,
    )
    heatmap = synergy_heatmaps(table)[0]
    plot = heatmap_plot(heatmap, ("synergy", "A", "B"))
    assert [rect.label for rect in plot.rects if "n/a" in rect.label] == [
        "t0, t0: n/a, no success, n = 24",
        "t1, t1: n/a, not told, n = 24",
    ]
    assert [text.text for text in plot.texts][:3] == ["n/a", "no success", "n = 24"]
    why = "overlapped without a success of the task (1), not told by the data (1)"
    assert f"Grey, n/a: {why}." in plot.notes
    assert f"Pairs without a coefficient: {why}." in synergy_coefficients(table)[0].captions


def test_a_colour_means_the_same_in_both_directions() -> None:
    frame_ = synergies(2).with_columns(pl.when(agent="A").then(3.0).otherwise("synergy").alias("synergy"))
    one, other = synergy_heatmaps(frame_)
    assert one.limit == other.limit == pytest.approx(3.0)
    assert one.paint(1.1) == other.paint(1.1)


def test_a_large_matrix_shows_what_overlaps_most_and_says_so() -> None:
    heatmap = synergy_heatmaps(synergies(MAX_SIDE + 5))[0]
    assert heatmap.values.shape == (MAX_SIDE, MAX_SIDE)
    assert heatmap.rows == tuple(f"t{index}" for index in range(5, MAX_SIDE + 5))
    assert f"{MAX_SIDE} of the {MAX_SIDE + 5} tasks of A are drawn, those that overlap most." in heatmap.captions
    assert np.isfinite(heatmap.values).all()


def test_a_heatmap_has_a_cell_per_pair_in_its_colour_and_says_its_value() -> None:
    heatmap = synergy_heatmaps(synergies(3))[0]
    plot = heatmap_plot(heatmap, ("synergy", "A", "B"))
    for rect, value in zip(plot.rects, heatmap.values.ravel(), strict=True):
        row, column = int(rect.low[1]), int(rect.low[0])
        assert heatmap.values[row, column] == pytest.approx(value, nan_ok=True)
        assert rect.paint == heatmap.paint(value)
        said = [text.text for text in plot.texts if (int(text.at[1]), int(text.at[0])) == (row, column)]
        number = f"{value:.2f}" if np.isfinite(value) else "n/a"
        assert said[0] == number + "*" * (row == column == 1)
        assert len(said) == (3 if np.isfinite(value) else 1)
    assert [name for _, name in plot.x.ticks] == [name for _, name in plot.y.ticks] == ["t0", "t1", "t2"]
    assert plot.y.low > plot.y.high  # the first row on top


def test_cells_too_small_for_their_notes_say_where_these_are() -> None:
    plot = heatmap_plot(synergy_heatmaps(synergies(20))[0], ("synergy", "A", "B"))
    assert len(plot.texts) == 400
    assert "Intervals and counts do not fit into the cells; the tables have them." in plot.notes
    assert "(n = " not in plot.texts[1].text
    assert "0.80 to 1.00, n = 9" in plot.rects[1].label


def test_coefficients_leave_out_the_unobserved_and_sort_by_size() -> None:
    plot = synergy_coefficients(synergies(3))[0]
    assert len(plot.rows) == 8
    assert [row.value for row in plot.rows] == sorted((row.value for row in plot.rows), reverse=True)
    assert "Pairs without a coefficient: never overlapped (1)." in plot.captions
    long = synergy_coefficients(synergies(9))[0]
    assert len(long.rows) == MAX_ROWS
    assert f"{MAX_ROWS} of 80 coefficients are drawn, those of the longest overlap." in long.captions


def test_intervals_that_leave_the_axis_are_clipped_and_said() -> None:
    frame_ = synergies(2).with_columns(pl.lit(999.0).alias("ci_high"))
    plot = coefficients_plot(synergy_coefficients(frame_)[0], ("coefficients", "A", "B"))
    assert all(plot.x.low <= x <= plot.x.high for stroke in plot.strokes for x, _ in stroke.points)
    assert plot.x.high < 110
    assert [text.text for text in plot.texts] == ["▸"] * 3
    assert "3 intervals reach beyond the axis; the table has the ends." in plot.notes
    narrow = coefficients_plot(synergy_coefficients(synergies(2))[0], ("coefficients", "A", "B"))
    assert not any("beyond" in note for note in narrow.notes)
    assert narrow.texts == ()


def test_a_coefficient_shows_its_standard_error_within_its_interval() -> None:
    frame_ = synergies(2).with_columns(pl.lit(0.05).alias("std_err"))
    plot = coefficients_plot(synergy_coefficients(frame_)[0], ("coefficients", "A", "B"))
    thick = [stroke for stroke in plot.strokes if stroke.width > 4]
    values = [dot.at[0] for dot in plot.dots]
    for stroke, value in zip(thick, values, strict=True):  # as far in ratio either way, as the axis is
        low, high = (x for x, _ in stroke.points)
        assert low * high == pytest.approx(value**2)
        assert high / value == pytest.approx(np.exp(0.05 / value))
    assert "+- 0.050 (95 %" in plot.dots[0].label
    hollow = [dot for dot in plot.dots if dot.paint == "card"]
    assert [dot.label.rpartition(", ")[2] for dot in hollow] == ["sparse"]


@given(st.lists(st.floats(0.1, 500, allow_nan=False), min_size=1, max_size=60))
@settings(max_examples=40)
def test_boxes_are_quartiles_and_every_execution_is_in_reach_or_an_outlier(lengths: list[float]) -> None:
    rows = frame(*(execution("R", "pick", 1000 * at, 1000 * at + length) for at, length in enumerate(lengths)))
    (plot,) = duration_boxes(rows)
    (box,) = plot.boxes
    sample = np.array([round(1000 * at * S + length * S) - 1000 * at * S for at, length in enumerate(lengths)]) / S
    np.testing.assert_allclose([box.q25, box.median, box.q75], np.quantile(sample, (0.25, 0.5, 0.75)), atol=1e-6)
    assert box.mean == pytest.approx(sample.mean(), abs=1e-6)
    inside = sum(box.low - 1e-6 <= length <= box.high + 1e-6 for length in sample)
    assert inside + len(box.outliers) == box.count == len(lengths)


def test_only_primary_executions_that_succeeded_count_as_durations() -> None:
    rows = frame(
        execution("R", "pick", 0, 5),
        execution("R", "pick", 5, 50, outcome="failed"),
        execution("R", "pick", 50, None),
        execution("R", "home", 60, 70, role="auxiliary"),
    )
    (plot,) = duration_boxes(rows)
    assert [(box.task, box.count, box.mean) for box in plot.boxes] == [("pick", 1, 5.0)]


def test_many_tasks_get_a_plot_per_agent_and_the_rest_is_said() -> None:
    rows = frame(
        *(execution(agent, f"t{index:03d}", 10 * index, 10 * index + 5) for agent in "AB" for index in range(45))
    )
    plots = duration_boxes(rows)
    assert [plot.agent for plot in plots] == ["A", "B"]
    assert all(len(plot.boxes) == MAX_BOXES for plot in plots)
    assert f"{MAX_BOXES} of 45 tasks are drawn, those executed most often." in plots[0].captions


def test_a_few_tasks_share_a_plot_and_more_of_them_do_not() -> None:
    for each, plots in ((12, [""]), (13, ["A", "B"])):
        rows = frame(
            *(execution(agent, f"t{index}", 10 * index, 10 * index + 5) for agent in "AB" for index in range(each))
        )
        assert [plot.agent for plot in duration_boxes(rows)] == plots


def test_outliers_beyond_the_limit_are_counted() -> None:
    lengths = [*([1.0] * 900), *range(100, 100 + MAX_OUTLIERS + 7)]
    rows = frame(*(execution("R", "pick", 1000 * at, 1000 * at + length) for at, length in enumerate(lengths)))
    (plot,) = duration_boxes(rows)
    assert len(plot.boxes[0].outliers) == MAX_OUTLIERS
    assert any(text.startswith("7 outliers are not drawn") for text in plot.captions)


def test_the_white_circle_of_a_box_is_its_mean() -> None:
    (plot,) = duration_boxes(
        frame(*(execution("R", "pick", start, start + length) for start, length in ((0, 3), (10, 4), (20, 11))))
    )
    drawn = boxplot_plot(plot, ("durations", "all"))
    mean = drawn.dots[-1]
    assert (mean.paint, mean.at[0]) == ((255, 255, 255), 6.0)
    assert mean.label == "R, pick: mean 6.000 s"
    assert (drawn.rects[0].low[0], drawn.rects[0].high[0]) == (3.5, 7.5)
    assert [name for _, name in drawn.y.ticks] == ["pick (3)"]


def test_a_timeline_draws_every_bar_and_names_it_as_far_as_there_is_room() -> None:
    rows = frame(
        execution("H", "pick", 1, 5), execution("R", "weld", 2, 2), execution("R", "weld", 3, 9, outcome="failed")
    )
    figures = run_figures(RUN, rows, events({"kind": "run_started", "time_ns": 0}), SIGNALS.to_frame())
    plot = gantt_plot(figures.gantt, ("run", "a", "timeline"))
    assert [(rect.low[0], rect.high[0]) for rect in plot.rects] == [(1.0, 5.0), (2.0, 2.0), (3.0, 9.0)]
    assert [text.text for text in plot.texts] == ["pick", "✗ weld failed"]
    assert [key.label for key in plot.keys] == ["pick", "weld", "failed or timed out"]
    assert plot.rects[2].label == "✗ weld failed: 3.00 to 9.00 s"
    assert [name for _, name in plot.y.ticks] == ["H", "R"]


def test_a_bar_without_room_for_its_name_says_its_beginning() -> None:
    rows = frame(
        execution("H", "a_long_name_of_a_task", 0, 5),
        execution("H", "a_long_name_of_a_task", 6, 7, outcome="failed"),
        execution("R", "other", 0, 100),
    )
    plot = gantt_plot(run_figures(RUN, rows, events(), SIGNALS.to_frame()).gantt, ("run", "a", "timeline"))
    assert [text.text for text in plot.texts] == ["a_lo…", "✗", "other"]


def test_a_task_has_one_colour_in_all_runs_of_a_campaign() -> None:
    tasks = [f"t{index}" for index in range(8)]
    one, other = (
        run_figures(
            RUN,
            frame(*(execution("H", task, at, at + 1) for at, task in enumerate(own))),
            events(),
            SIGNALS.to_frame(),
            tasks=tasks,
        )
        for own in (tasks[:5], tasks[3:])
    )
    assert {name: color for name, color in one.gantt.tasks if name in tasks[3:5]} == {
        name: color for name, color in other.gantt.tasks if name in tasks[3:5]
    }
    assert [name for name, _ in other.gantt.tasks] == tasks[3:]


def test_colours_of_tasks_are_none_of_those_that_mean_something() -> None:
    meaning = np.array([FAILED, PAUSED, REDUCED, FULL_SPEED], float)
    apart = np.abs(np.array(TASKS, float)[:, None] - meaning[None]).max(axis=2)
    assert apart.min() > 30


def test_the_signals_of_a_run_stand_under_the_axis_of_its_timeline() -> None:
    rows = [("run", name, at * S // 100, float(at % 7)) for name in ("R/j1", "a/x", "gap", "z/y") for at in range(5000)]
    rows.append(("run", "gap", 51 * S, float("nan")))
    figures = run_figures(RUN, frame(), events(), pl.DataFrame(rows, schema=SIGNALS, orient="row"))
    timeline, *lines = run_plots(figures)
    assert len({plot.path for plot in (timeline, *lines)}) == 5
    assert {plot.x for plot in lines} == {timeline.x}
    for plot in lines:
        (stroke,) = plot.strokes
        assert len(stroke.points) <= 2402
        assert (stroke.points[0], stroke.points[-1]) == ((0.0, 0.0), (49.99, 4999 % 7))
        assert {y for _, y in stroke.points} >= {0.0, 6.0}


@given(st.lists(st.tuples(st.sampled_from("HR"), st.integers(0, 50), st.integers(1, 10)), min_size=2, max_size=12))
def test_the_overlap_so_far_ends_at_the_time_in_which_both_were_busy(found: list[tuple[str, int, int]]) -> None:
    rows = frame(*(execution(agent, "t", start, start + length) for agent, start, length in found))
    lines, left_out = overlaps_so_far(rows, 0)
    both = [
        at
        for at in range(60)
        if {agent for agent, start, length in found if start <= at < start + length} == {"H", "R"}
    ]
    assert not left_out
    assert len(lines) == len({agent for agent, _, _ in found}) - 1
    for line in lines:
        assert line.values[-1] == len(both)
        assert (np.diff(line.values) >= 0).all()


def test_a_speed_scale_holds_until_the_next_and_to_the_end() -> None:
    log = events(
        {"kind": "safety_state_changed", "agent": "R", "time_ns": 3, "speed_scale": 0.0, "mode": "stop"},
        {"kind": "safety_state_changed", "agent": "R", "time_ns": 5, "speed_scale": 1.0, "mode": "normal"},
    )
    (line,) = speed_scales(log, 1, 11)
    assert line.step
    assert line.times_ns.tolist() == [2, 4, 10]
    assert line.values.tolist() == [0.0, 1.0, 1.0]


def test_signals_are_grouped_and_what_is_left_out_is_said() -> None:
    rows = [("run", name, at, float(at)) for name in ("R/j1", "R/j2", "gap") for at in range(10)]
    signals = pl.DataFrame(rows, schema=SIGNALS, orient="row")
    lines, captions = signal_series(signals, 0, max_series=2, max_samples=5)
    assert [(line.group, line.name, len(line.values)) for line in lines] == [("R", "R/j1", 2), ("R", "R/j2", 2)]
    assert captions == [
        "The first 2 of 3 signals are drawn.",
        "2 signals are thinned to their lowest and highest values.",
    ]


def test_the_log_says_who_did_what_and_stops_aloud() -> None:
    log = events(
        {"kind": "task_ended", "agent": "R", "task": "pick", "outcome": "failed", "reason": "lost", "time_ns": 5},
        {"kind": "heartbeat", "time_ns": 6},
        {"kind": "heartbeat", "time_ns": 7},
    )
    lines = event_lines(log, 5, max_lines=2)
    assert lines.texts == ("task ended: R pick (failed, lost)", "heartbeat")
    assert lines.levels == ("ERROR", "DEBUG")
    assert lines.times_ns == (0, 1)
    assert lines.captions == ("The log lists the first 2 of 3 events.",)


def test_times_in_a_run_count_from_its_first_event() -> None:
    rows = frame(execution("H", "pick", 100, 105), execution("R", "weld", 103, 110))
    log = events({"kind": "run_started", "time_ns": 99 * S}, {"kind": "run_ended", "time_ns": 111 * S})
    figures = run_figures(RUN, rows, log, SIGNALS.to_frame())
    assert figures.origin_ns == 99 * S
    assert (figures.gantt.start_ns, figures.gantt.end_ns) == (0, 12 * S)
    assert [(lane.agent, lane.bars[0].start_ns) for lane in figures.gantt.lanes] == [("H", 1 * S), ("R", 4 * S)]
    assert figures.tasks.frame["start_s"].to_list() == [1.0, 4.0]
    assert figures.series[0].values[-1] == 2.0


def test_a_campaign_has_the_same_id_in_any_order_of_its_runs() -> None:
    runs = pl.DataFrame([RUN | {"run_id": name} for name in "abc"], schema=RUNS, orient="row")
    made = [
        campaign_figures(frame(), PAIR_OVERLAPS.to_frame(), DURATIONS.to_frame(), SYNERGIES.to_frame(), some, [])
        for some in (runs, runs.reverse(), runs.head(2))
    ]
    assert made[0].campaign_id == made[1].campaign_id != made[2].campaign_id


def test_nothing_at_all_makes_figures_that_say_so() -> None:
    campaign = campaign_figures(
        frame(),
        PAIR_OVERLAPS.to_frame(),
        DURATIONS.to_frame(),
        SYNERGIES.to_frame(),
        RUNS.to_frame(),
        [Diagnostic("no_events", "none")],
    )
    assert [page.name for page in campaign.pages] == ["Durations"]
    assert campaign.matrices == ()
    assert campaign.captions == ("No two agents have tasks to compare: no overlaps, no synergies.",)
    assert campaign.pages[0].plots[0].rects == ()
    diagnostics = next(table for table in campaign.tables if table.name == "diagnostics")
    assert diagnostics.frame["code"].to_list() == ["no_events"]
    run = run_figures(RUN, frame(), events(), SIGNALS.to_frame())
    assert run.gantt.lanes == ()
    assert run.series == ()
    assert (run.gantt.start_ns, run.gantt.end_ns) == (0, 0)


def test_pairs_that_never_overlap_are_drawn_as_unobserved() -> None:
    pairs = cells(PAIR_OVERLAPS, 2, overlap_s=lambda *_: 0.0, n=lambda *_: 0, mean_ratio=lambda *_: 0.0)
    nothing = cells(SYNERGIES, 2, n=lambda *_: 0, overlap_s=lambda *_: 0.0, status=lambda *_: "unobserved")
    (seconds, _), _ = overlap_matrices(pairs)
    assert (seconds.values == 0).all()
    heatmap = synergy_heatmaps(nothing)[0]
    assert np.isnan(heatmap.values).all()
    plot = heatmap_plot(heatmap, ("synergy", "A", "B"))
    assert [rect.paint for rect in plot.rects] == ["unobserved"] * 4
    assert [text.text for text in plot.texts] == ["n/a"] * 4
    assert synergy_coefficients(nothing)[0].rows == ()
    empty = coefficients_plot(synergy_coefficients(nothing)[0], ("coefficients", "A", "B"))
    assert empty.dots == empty.strokes == ()
    assert empty.y.ticks == ((0.5, ""),)


def test_of_many_agents_the_pairs_that_overlap_most_are_drawn() -> None:
    agents = "ABCDE"
    rows = [
        {"agent": one, "task": "t", "other_agent": other, "other_task": "t", "n": 1, "mean_ratio": 0.1}
        | {"overlap_s": float(agents.index(one) + agents.index(other))}
        for one in agents
        for other in agents
        if one != other
    ]
    pairs = pl.DataFrame([{name: row.get(name) for name in PAIR_OVERLAPS} for row in rows], PAIR_OVERLAPS, orient="row")
    campaign = campaign_figures(
        frame(), pairs, DURATIONS.to_frame(), SYNERGIES.to_frame(), RUNS.to_frame(), [], Further(settling_note="a note")
    )
    drawn = {matrix.heatmap.agents for matrix in campaign.matrices}
    assert len(drawn) == MAX_AGENT_PAIRS
    assert {("D", "E"), ("E", "D"), ("C", "E")} <= drawn
    assert ("A", "B") not in drawn
    said = f"Matrices and coefficients of {MAX_AGENT_PAIRS} of 20 pairs of agents are drawn, those that overlap most"
    assert any(said in caption for caption in campaign.captions)


def test_intervals_of_drawn_runs_are_told_from_those_of_the_steps() -> None:
    rows = [
        {"agent": "A", "task": "t", "other_agent": "B", "other_task": "u", "estimator": "aft", "status": "ok", "n": 5}
        | {"runs": runs, "synergy": 1.5, "std_err": 0.1, "ci_low": 1.3, "ci_high": 1.7, "overlap_s": 4.0}
        for runs in (1, 2)
    ]
    settling = pl.DataFrame([{name: row.get(name) for name in SETTLING} for row in rows], SETTLING, orient="row")
    campaign = campaign_figures(
        frame(),
        PAIR_OVERLAPS.to_frame(),
        DURATIONS.to_frame(),
        SYNERGIES.to_frame(),
        RUNS.to_frame(),
        [],
        Further(settling=settling, settling_note="other intervals"),
    )
    settled = [
        plot
        for page in campaign.pages
        if page.name.startswith(("Settling", "Synergy over"))
        for plot in page_plots(page)
    ]
    assert len(settled) == 2
    assert all("other intervals" in plot.notes for plot in settled)
