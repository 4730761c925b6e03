"""Names on pictures: whatever is different looks different, in the room that there is."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence

import polars as pl
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hrclog.analyzers.figures.coefficients import pair_names, synergy_coefficients
from hrclog.analyzers.figures.heatmap_plot import heatmap_plot
from hrclog.analyzers.figures.overlap_matrix import overlap_matrices
from hrclog.analyzers.figures.synergy_heatmap import synergy_heatmaps
from hrclog.analyzers.figures.text import UNNAMED, beginning, ending, markdown_escape, printable, shorten, shorten_apart
from hrclog.analyzers.projections.schemas import PAIR_OVERLAPS, SYNERGIES

SIDES = [f"robot_arm_station_{side}_side_01_left_gripper_a" for side in ("north", "south")]
CORNERS = [f"pick_a_very_long_task_name_for_{box}_corner" for box in ("blue_box_south", "red_box_north")]
FROM = [f"place_blue_box_human_right_from_pick_{color}_box_of_the_left_feeder" for color in ("orange", "purple")]

ALIKE = st.builds(
    lambda start, middle, end: start + middle + end,
    st.sampled_from(["", "robot_" * 6, "a" * 30]),
    st.text("ab…()2", max_size=4),
    st.sampled_from(["", "_gripper" * 5, "a" * 20]),
)


def pairs(agents: Sequence[str], tasks: Sequence[str], schema: dict[str, pl.DataType]) -> pl.DataFrame:
    """Return rows of the first agent beside each other one, in which every task met every other."""
    known = {"synergy": 1.5, "std_err": 0.1, "ci_low": 1.2, "ci_high": 1.8, "n": 9, "overlap_s": 5.0, "mean_ratio": 0.5}
    rows = [
        {**known, "agent": agents[0], "other_agent": other, "task": task, "other_task": meanwhile}
        for other in agents[1:]
        for task in tasks
        for meanwhile in tasks
    ]
    said = {"status": "ok", "estimator": "aft"}
    return pl.DataFrame(
        [{name: {**row, **said}.get(name) for name in schema} for row in rows], schema=schema, orient="row"
    )


@given(st.lists(st.one_of(st.text(max_size=60), ALIKE), max_size=12), st.integers(8, 40), st.randoms())
@settings(max_examples=150, deadline=None)
@example(["a" * length for length in range(9, 40)], 8, random.Random(0))
@example(["a" * 20, "aaaaa…aa", "aaaaa(2)"], 8, random.Random(0))
@example(["", "\n", UNNAMED, "(unna…d)"], 8, random.Random(0))
def test_unlike_names_have_unlike_labels_and_short_ones_stay(
    names: list[str], width: int, source: random.Random
) -> None:
    labels = shorten_apart(names, width)
    wholes = {printable(name) for name in names}
    assert len(set(labels.values())) == len(wholes)
    assert len({printable(label) for label in labels.values()}) == len(wholes)
    assert all(0 < len(label) <= width for label in labels.values())
    assert all(labels[name] == printable(name) for name in names if len(printable(name)) <= width)
    assert shorten_apart(source.sample(names, len(names)), width) == labels


@pytest.mark.parametrize(
    ("cut", "pattern"),
    [(shorten, "{0}_{1}_{0}"), (ending, "{2}_{0}_{1}"), (beginning, "{1}_{0}_{2}")],
)
def test_all_are_cut_where_all_stay_apart(cut: Callable[[str, int], str], pattern: str) -> None:
    names = [pattern.format(number, "x" * 9, "y" * 30) for number in range(10, 14)]
    if cut is shorten:
        names = [f"{name}_{'z' * 30}_{name[-2:]}" for name in names]
    assert shorten_apart(names, 16) == {name: cut(name, 16) for name in names}


def test_names_that_differ_in_their_middle_show_it() -> None:
    assert list(shorten_apart(SIDES, 18).values()) == ["robot…north_side_…", "robot…south_side_…"]


def test_names_that_no_cut_tells_apart_are_numbered() -> None:
    labels = shorten_apart(["a" * length for length in (50, 51, 52)], 10)
    assert sorted(label[-3:] for label in labels.values()) == ["(2)", "(3)", "aaa"]


def test_joiners_stay_where_scripts_need_them() -> None:
    assert printable("👩\u200d🔧 می\u200cروم") == "👩\u200d🔧 می\u200cروم"
    assert printable("a\u200db \u200cx 🔧\u200d\u200d🔧\u200d") == "a·b ·x 🔧··🔧·"


def test_a_markdown_cell_shows_entities_as_they_are() -> None:
    assert markdown_escape("&lt;script&gt;") == r"\&lt;script\&gt;"


@given(st.lists(st.tuples(ALIKE, ALIKE), min_size=1, max_size=8, unique=True))
@settings(max_examples=60, deadline=None)
def test_pairs_of_names_show_both_and_none_is_like_another(found: list[tuple[str, str]]) -> None:
    found = list({(printable(one), printable(other)): (one, other) for one, other in found}.values())
    names = pair_names(found, 30)
    assert len(set(names.values())) == len(found)
    for (one, other), name in names.items():
        left, right = name.split(" | ")
        assert left.startswith(("…", printable(one)[:2]))
        assert right.startswith(("…", printable(other)[:2]))
        assert len(left) + len(right) <= 30


def test_a_short_name_leaves_its_room_to_the_other() -> None:
    assert set(pair_names([("pick", "x" * 26), ("put", "y" * 26)], 30).values()) == {
        f"pick | {'x' * 26}",
        f"put | {'y' * 26}",
    }
    whole, cut = pair_names([("screw", "x" * 25), ("s" * 25, "y" * 25)], 30).values()
    assert whole == f"screw | {'x' * 25}"
    assert len(cut) == 33


def test_a_task_is_told_from_those_that_are_not_drawn() -> None:
    found = pairs(["human", "robot"], FROM, SYNERGIES)
    unseen = pl.when((pl.col("task") == FROM[0]) & (pl.col("other_task") == FROM[1])).then(pl.col("synergy"))
    (plot,) = synergy_coefficients(found.with_columns(unseen))
    (row,) = plot.rows
    assert "orange" in row.name
    assert "purple" in row.name


def test_coefficients_show_both_tasks_and_say_them_in_full() -> None:
    (plot,) = synergy_coefficients(pairs(["human", "robot"], FROM, SYNERGIES))
    assert len({row.name for row in plot.rows}) == 4
    assert all("orange" in row.name or "purple" in row.name for row in plot.rows)
    assert all(len(row.name) <= 33 for row in plot.rows)
    assert {row.full for row in plot.rows} == {f"{one} | {other}" for one in FROM for other in FROM}


def test_pictures_of_agents_that_are_called_alike_have_titles_of_their_own() -> None:
    synergies = pairs(["human", *SIDES], CORNERS, SYNERGIES)
    heatmaps = synergy_heatmaps(synergies)
    assert len({plot.title for plot in heatmaps}) == 2
    assert len({plot.column_title for plot in heatmaps}) == 2
    both = overlap_matrices(pairs(["human", *SIDES], CORNERS, PAIR_OVERLAPS))
    assert len({plot.title for pair in both for plot in pair}) == 4
    titles = {plot.title for plot in synergy_coefficients(synergies)}
    assert len(titles) == 2
    assert all(title.endswith(" (aft)") for title in titles)


def test_rows_and_columns_of_a_matrix_are_told_apart() -> None:
    middle = [f"the_robot_of_the_hall_puts_box_{color}_on_the_second_table_of_it" for color in ("A", "B", "C")]
    (heatmap,) = synergy_heatmaps(pairs(["human", "robot"], middle, SYNERGIES))
    plot = heatmap_plot(heatmap, ("synergy",))
    for axis in (plot.x, plot.y):
        assert len({name for _, name in axis.ticks}) == 3


def test_counts_say_what_they_count() -> None:
    (heatmap,) = synergy_heatmaps(pairs(["human", "robot"], ["a"], SYNERGIES))
    (coefficients,) = synergy_coefficients(pairs(["human", "robot"], ["a"], SYNERGIES))
    for reading in (heatmap.reading, coefficients.reading):
        assert "executions that overlapped and were used" in reading
    ((seconds, _),) = overlap_matrices(pairs(["human", "robot"], ["a"], PAIR_OVERLAPS))
    assert "of all executions, failed ones too" in seconds.reading
    assert "relative to the task's mean over all its executions" in heatmap.reading
