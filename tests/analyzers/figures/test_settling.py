"""Pictures of settling: every step alike, nothing drawn that is not known, and names that can be read."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from interval_frames import frame, random_runs, seconds
from plot_marks import check
from run_frames import runs_of

from hrclog.analyzers.figures.curves import MAX_CURVES, log_ticks
from hrclog.analyzers.figures.heatmap import MAX_SIDE
from hrclog.analyzers.figures.palette import LINES
from hrclog.analyzers.figures.plot import Plot, Stroke
from hrclog.analyzers.figures.settling import duration_curves, settling_curves, settling_heatmaps
from hrclog.analyzers.projections.schemas import SETTLING, SETTLING_DURATIONS
from hrclog.analyzers.synergy.settling import settle, settle_durations

if TYPE_CHECKING:
    from conftest import Runs

Factor = tuple[float, float, float] | None


def settling(*steps: tuple[int, dict[str, Factor]]) -> pl.DataFrame:
    """Return a frame of what H's tasks take while R does r: per step factor, low and high by task, None if unseen."""
    rows = [
        {
            "runs": runs,
            "agent": "H",
            "task": task,
            "other_agent": "R",
            "other_task": "r",
            "synergy": found and found[0],
            "std_err": found and (found[2] - found[1]) / 4,
            "ci_low": found and found[1],
            "ci_high": found and found[2],
            "n": runs if found else 0,
            "overlap_s": float(runs) if found else 0.0,
            "status": "ok" if found else "unobserved",
            "estimator": "ols",
        }
        for runs, factors in steps
        for task, found in factors.items()
    ]
    return pl.DataFrame(rows, schema=SETTLING)


def one_plot(plots: list[Plot]) -> Plot:
    assert len(plots) == 1
    check(plots[0])
    return plots[0]


def lines(plot: Plot) -> list[Stroke]:
    """Return the strokes of the curves: no grid, no leader to a name."""
    return [stroke for stroke in plot.strokes if stroke.label]


def random_settling(runs: int = 6) -> tuple[pl.DataFrame, pl.DataFrame]:
    executions = frame(random_runs(2, runs, agents="HR", tasks=4))
    return settle(executions, runs_of(executions), "aft"), settle_durations(executions, runs_of(executions))


def test_each_step_of_a_matrix_shows_what_was_known_then() -> None:
    found, _ = random_settling()
    steps = settling_heatmaps(found)
    assert [step.numbers for step in steps] == [(1, 2, 6)] * 2
    for step, (agent, other) in zip(steps, (("H", "R"), ("R", "H")), strict=True):
        assert len({plot.path for plot in step.plots}) == 1
        for number, plot in zip(step.numbers, step.plots, strict=True):
            check(plot)
            cells = found.filter(runs=number, agent=agent, other_agent=other)
            assert sorted(rect.label.split(": ")[1].split(",")[0].rstrip("*") for rect in plot.rects) == sorted(
                "n/a" if value is None else f"{value:,.2f}" for value in cells["synergy"]
            )
            assert f"after {number} of 6 runs" in plot.title


def test_all_steps_of_a_matrix_have_the_same_axes_notes_and_colours() -> None:
    found, _ = random_settling()
    for step in settling_heatmaps(found):
        assert len({(plot.x, plot.y, plot.area, plot.notes, plot.color_bar.paints) for plot in step.plots}) == 1  # type: ignore[union-attr]  # a heatmap has one
    paints: dict[str, set[object]] = {}
    for step in settling_heatmaps(found):
        for plot in step.plots:
            for rect in plot.rects:
                paints.setdefault(rect.label.split(": ")[1].split(",")[0].rstrip("*"), set()).add(rect.paint)
    assert len(paints["n/a"]) == 1
    far = settling((1, {"a": (9.0, 8.0, 10.0)}), (2, {"a": (1.1, 1.0, 1.2)}))
    first, last = settling_heatmaps(far)[0].plots
    assert "or more" in str(first.color_bar)
    assert last.rects[0].paint != first.rects[0].paint


def test_a_large_matrix_has_the_tasks_of_the_longest_overlap_in_all_steps() -> None:
    tasks = {f"t{number:02}": (1.0, 0.9, 1.1) for number in range(MAX_SIDE + 3)}
    few = {task: factor if task > "t10" else None for task, factor in tasks.items()}
    found = settling((1, few), (2, tasks)).with_columns(
        pl.when(pl.col("runs") == 2)
        .then(pl.col("task").str.slice(1).cast(pl.Float64))
        .otherwise(1.0)
        .alias("overlap_s")
    )
    (step,) = settling_heatmaps(found)
    expected = sorted(tasks)[3:]
    for plot in step.plots:
        assert [name for _, name in plot.y.ticks] == expected
        assert any(f"{MAX_SIDE} of the {MAX_SIDE + 3} tasks" in note for note in plot.notes)


def test_every_dot_is_in_the_frame_and_every_known_value_of_a_drawn_pair_has_one() -> None:
    found, means = random_settling(12)
    for frame_, value, plots in (
        (found, "synergy", settling_curves(found)),
        (means, "mean_s", duration_curves(means)),
    ):
        assert len(plots) == 2
        for plot in plots:
            check(plot)
            agent = plot.path[2]
            known = frame_.filter(pl.col(value).is_not_null(), agent=agent)
            pairs = {(float(runs), number) for runs, number in known.select("runs", value).iter_rows()}
            assert {dot.at for dot in plot.dots} <= pairs
            if value == "mean_s":
                assert {dot.at for dot in plot.dots} == pairs
            on_lines = {point for stroke in lines(plot) for point in stroke.points if len(stroke.points) > 2}
            assert on_lines <= {dot.at for dot in plot.dots}


def test_a_line_breaks_where_nothing_is_known() -> None:
    known = (1.5, 1.2, 1.8)
    plot = one_plot(
        settling_curves(settling((1, {"a": known}), (2, {"a": None}), (5, {"a": known}), (9, {"a": known})))
    )
    assert [dot.at for dot in plot.dots] == [(1.0, 1.5), (5.0, 1.5), (9.0, 1.5)]
    alone, line = lines(plot)
    assert alone.points == ((1.0, 1.2), (1.0, 1.8)), "a step of its own shows its interval by a stroke"
    assert line.points == ((5.0, 1.5), (9.0, 1.5))
    (band,) = plot.bands
    assert (band.x, band.low, band.high) == ((5.0, 9.0), (1.2, 1.2), (1.8, 1.8))


def test_those_surest_to_differ_from_one_are_drawn() -> None:
    factors: dict[str, Factor] = {f"t{n}": (1.0 + n / 10, 0.5 + n / 10, 1.5 + n / 10) for n in range(10)}
    factors["sure"] = (0.9, 0.89, 0.91)
    factors["never"] = None
    plot = one_plot(settling_curves(settling((1, factors), (2, factors))))
    assert [text.text.split()[0] for text in plot.texts] == ["sure", *(f"t{n}" for n in range(9, 2, -1))]
    assert any("8 of 11 factors" in note for note in plot.notes)
    assert any("without a factor after all runs: 1." in note for note in plot.notes)
    assert [dot.paint for dot in plot.dots[::2]] == list(LINES[:MAX_CURVES])


def test_factors_without_an_error_come_last_and_negative_ones_not_at_all() -> None:
    found = settling(
        (1, {"a": (3.0, 2.0, 4.0), "b": (1.1, 1.0, 1.2), "c": (-2.0, -3.0, 4.0), "d": (2.0, -1.0, 5.0)}),
        (2, {"a": (3.0, 2.0, 4.0), "b": (1.1, 1.0, 1.2), "c": (-2.0, -3.0, 4.0), "d": (2.0, -1.0, 5.0)}),
    )
    errors = ("std_err", "ci_low", "ci_high")
    bare = found.with_columns(pl.when(pl.col("task") == "a").then(None).otherwise(name).alias(name) for name in errors)
    plot = one_plot(settling_curves(bare))
    assert [text.text.split()[0] for text in plot.texts] == ["b", "d", "a"]
    assert len(plot.bands) == 2
    assert plot.notes[-1] == "Intervals that reach beyond the axis are cut off."
    negative = (-2.0, -3.0, 4.0)
    assert not settling_curves(settling((1, {"c": negative}), (2, {"c": negative})))
    late = one_plot(settling_curves(settling((1, {"c": negative}), (2, {"c": (1.5, 1.2, 1.8)}))))
    assert [dot.at for dot in late.dots] == [(2.0, 1.5)]
    assert late.x.ticks == ((1.0, "1"), (2.0, "2")), "a step that knows nothing is a step"


@given(st.lists(st.floats(0.05, 20), min_size=1, max_size=MAX_CURVES))
@settings(max_examples=40)
def test_names_stand_apart_in_the_order_of_their_lines(values: list[float]) -> None:
    factors: dict[str, Factor] = {f"t{n}": (value, value / 1.1, value * 1.1) for n, value in enumerate(values)}
    plot = one_plot(settling_curves(settling((1, factors), (2, factors))))
    share = math.log(plot.y.high / plot.y.low)
    placed = sorted((math.log(text.at[1] / plot.y.low) / share * plot.area[1], text.text) for text in plot.texts)
    assert all(high - low > 19 for (low, _), (high, _) in pairwise(placed))
    assert placed[0][0] > 9
    assert placed[-1][0] < plot.area[1] - 9
    by_value = [values[int(text.strip()[1:].split()[0])] for _, text in placed]
    assert by_value == pytest.approx(sorted(by_value), rel=1e-12), "but for values that are one on a logarithmic axis"


def test_means_that_are_least_sure_are_drawn() -> None:
    rows = [(runs, "H", f"t{n}", 5, 4.0, 4.0 - n / 10, 4.0 + n / 10) for runs in (1, 2) for n in range(10)]
    rows += [(runs, "H", "once", 1, 4.0, None, None) for runs in (1, 2)]
    rows += [(runs, "H", "never", 0, None, None, None) for runs in (1, 2)]
    plot = one_plot(duration_curves(pl.DataFrame(rows, schema=SETTLING_DURATIONS, orient="row")))
    assert [text.text.strip() for text in plot.texts] == [f"t{n}" for n in range(9, 1, -1)]
    assert any("8 of 11 tasks" in note for note in plot.notes)
    assert any("never succeeded: 1." in note for note in plot.notes)


def test_the_order_of_rows_does_not_matter() -> None:
    found, means = random_settling()
    mixed, mixed_means = (one.sample(fraction=1, shuffle=True, seed=7) for one in (found, means))
    assert settling_heatmaps(mixed) == settling_heatmaps(found)
    assert settling_curves(mixed) == settling_curves(found)
    assert duration_curves(mixed_means) == duration_curves(means)


def test_ends_of_lines_are_named_apart() -> None:
    known = (1.5, 1.2, 1.8)
    tasks = [f"place_the_large_box_number_{number}_on_the_table_of_the_robot" for number in range(4)]
    factors: dict[str, Factor] = dict.fromkeys(tasks, known)
    found = settling((1, factors), (2, factors))
    plot = one_plot(settling_curves(found.with_columns(other_task=pl.lit("screw_the_lid_on_with_the_long_driver"))))
    assert len({text.text for text in plot.texts}) == 4
    assert all(" | screw_the" in text.text for text in plot.texts)
    rows = [(runs, "H", task, 5, 4.0, 3.0, 5.0) for runs in (1, 2) for task in tasks]
    means = one_plot(duration_curves(pl.DataFrame(rows, schema=SETTLING_DURATIONS, orient="row")))
    assert len({text.text for text in means.texts}) == 4


def test_titles_tell_agents_apart() -> None:
    known = (1.5, 1.2, 1.8)
    found = settling((1, {"a": known}), (2, {"a": known}))
    arms = [f"robot_arm_station_{side}_side_01_left_gripper_a" for side in ("north", "south")]
    both = pl.concat(found.with_columns(other_agent=pl.lit(arm)) for arm in arms)
    assert len({plot.title for plot in settling_curves(both)}) == 2
    assert len({step.title for step in settling_heatmaps(both)}) == 2
    rows = [(runs, arm, "a", 5, 4.0, 3.0, 5.0) for runs in (1, 2) for arm in arms]
    assert (
        len({plot.title for plot in duration_curves(pl.DataFrame(rows, schema=SETTLING_DURATIONS, orient="row"))}) == 2
    )


def test_a_flat_line_is_not_said_to_be_settled() -> None:
    found, means = random_settling()
    for plot in (*settling_curves(found), *duration_curves(means)):
        assert "a flat one may still move if the work changes" in plot.reading
    assert all(any("executions as independent" in note for note in plot.notes) for plot in duration_curves(means))


def test_a_note_stands_under_each_picture_of_factors() -> None:
    found, _ = random_settling()
    note = "Intervals here are the estimator's own."
    plots = [*settling_curves(found, note=note), *(p for s in settling_heatmaps(found, note=note) for p in s.plots)]
    assert plots
    assert all(note in plot.notes for plot in plots)
    assert all("" not in plot.notes for plot in (*settling_curves(found), *settling_heatmaps(found)[0].plots))


def test_one_step_settles_nothing() -> None:
    found, means = random_settling(1)
    assert not settling_heatmaps(found)
    assert not settling_curves(found)
    assert not duration_curves(means)
    assert not settling_heatmaps(SETTLING.to_frame())


def test_agents_that_never_overlap_settle_no_factors_but_their_durations() -> None:
    apart = frame(
        [one for run in "abc" for one in [*seconds("H", (0, 4), run_id=run), *seconds("R", (9, 4), run_id=run)]]
    )
    found = settle(apart, runs_of(apart), "aft")
    assert not settling_heatmaps(found)
    assert not settling_curves(found)
    assert len(duration_curves(settle_durations(apart, runs_of(apart)))) == 2


@given(st.floats(1e-4, 1e4), st.floats(1.02, 1e8))
@settings(max_examples=60)
def test_an_axis_of_factors_has_round_ticks(low: float, ratio: float) -> None:
    ticks = log_ticks(low, low * ratio)
    assert 2 <= len(ticks) <= 16
    assert all(low * (1 - 1e-9) <= value <= low * ratio * (1 + 1e-9) for value, _ in ticks)
    assert all(float(name) == pytest.approx(value) for value, name in ticks)
    assert len({name for _, name in ticks}) == len(ticks)


@pytest.mark.slow
def test_the_authors_runs_are_drawn(offline: Runs) -> None:
    runs = runs_of(offline.intervals)
    found = settle(offline.intervals, runs, "ols")
    for plot in [*settling_curves(found), *duration_curves(settle_durations(offline.intervals, runs))]:
        check(plot)
    assert [step.numbers for step in settling_heatmaps(found)] == [(1, 2, 5, 10, 20, 51)] * 2
