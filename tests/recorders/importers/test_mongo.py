"""The Mongo importer: exact, idempotent, and not to be fooled."""

from __future__ import annotations

import json
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hrclog.analyzers.projections.intervals import intervals
from hrclog.errors import ImportDataError, OutputError
from hrclog.log.one_log import read_log
from hrclog.log.reader import read_logs
from hrclog.recorders.importers.mongo import import_mongo
from hrclog.recorders.importers.mongo_runs import run_events
from hrclog.recorders.importers.writing import exact_ns, file_name

pytestmark = pytest.mark.slow

Document = dict[str, Any]


def document(number: int = 0, **values: object) -> Document:
    start = 1_689_090_425.5 + 10 * number
    return {
        "_id": {"$oid": f"{number:024x}"}, "name": "pick", "type": "pick", "outcome": 1, "duration_planned": 5.0,
        "duration_real": 5.8, "planning_time": 0.36, "path_length": 4.5, "date": {"$date": "2023-07-11T15:47:11.447Z"},
        "recipe": "recipe_1", "agent": "R", "t_start": start, "t_end": start + 6.25,
        "t_start_planned": 10.0 * number, "t_end_planned": 10.0 * number + 6,
    } | values  # fmt: skip


def dump(path: Path, *documents: object) -> Path:
    path.write_text(json.dumps(documents))
    return path


def snapshot(folder: Path) -> dict[str, tuple[bytes, int]]:
    return {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in folder.iterdir()}


def only_row(folder: Path) -> Document:
    rows = intervals(read_logs([folder]).events).to_dicts()
    assert len(rows) == 1
    return rows[0]


def test_the_offline_runs_are_51_logs_and_importing_again_adds_nothing(data_dir: Path, tmp_path: Path) -> None:
    source, folder = data_dir / "safety_areas" / "task_results.json", tmp_path / "A"
    first = import_mongo([source], folder)
    assert (len(first.written), len(first.unchanged), first.n_executions, first.diagnostics) == (51, 0, 1224, [])
    before = snapshot(folder)
    assert len(before) == 51
    second = import_mongo([source], folder)
    assert (len(second.written), len(second.unchanged), second.n_executions) == (0, 51, 1224)
    assert snapshot(folder) == before


def test_an_import_elsewhere_is_the_same_to_the_byte(data_dir: Path, tmp_path: Path) -> None:
    source = data_dir / "safety_areas" / "task_results.json"
    for name in "AB":
        import_mongo([source], tmp_path / name)
    contents = [{name: facts[0] for name, facts in snapshot(tmp_path / folder).items()} for folder in "AB"]
    assert contents[0] == contents[1]


def test_the_online_runs_are_200_logs_of_24_executions(data_dir: Path, tmp_path: Path) -> None:
    found = import_mongo([data_dir / "safety_areas" / "task_results_online.json"], tmp_path)
    assert (len(found.written), found.n_executions, len(set(found.runs))) == (200, 4800, 200)
    assert intervals(read_logs([tmp_path]).events).group_by("run_id").len()["len"].unique().to_list() == [24]


def test_every_fact_of_the_real_runs_is_kept_and_every_time_is_exact(data_dir: Path, tmp_path: Path) -> None:
    source = data_dir / "safety_areas" / "task_results.json"
    documents = json.loads(source.read_text())
    import_mongo([source], tmp_path)
    events = read_logs([tmp_path]).events
    names = {
        run: json.loads(details)["name"]
        for run, details in events.filter(pl.col("kind") == "run_started").select("run_id", "details").iter_rows()
    }
    ends = events.filter(pl.col("kind") == "task_ended").select("execution_id", "details").rows()
    details = {execution: json.loads(text) for execution, text in ends}
    rows = {
        (names[row["run_id"]], row["agent"], row["start_ns"]): row | details[row["execution_id"]]
        for row in intervals(events).to_dicts()
    }
    zero: dict[str, float] = {}
    for one in documents:
        zero[one["recipe"]] = min(zero.get(one["recipe"], one["t_start"]), one["t_start"])
    assert len(rows) == len(documents) == 1224
    for one in documents:
        row = rows[one["recipe"], one["agent"], exact_ns(one["t_start"])]
        assert abs(Decimal(row["start_ns"]) - Decimal(one["t_start"]) * 10**9) <= Decimal("0.5")
        assert abs(Decimal(row["end_ns"]) - Decimal(one["t_end"]) * 10**9) <= Decimal("0.5")
        origin = exact_ns(zero[one["recipe"]])
        assert row["planned_start_ns"] == origin + exact_ns(one["t_start_planned"])
        assert row["planned_end_ns"] == origin + exact_ns(one["t_end_planned"])
        kept = ("planned_duration_s", "planning_time_s", "path_length", "duration_real", "date", "task", "task_type")
        theirs = ("duration_planned", "planning_time", "path_length", "duration_real", "date", "name", "type")
        assert [row[name] for name in kept] == [one[name] for name in theirs]
        assert row["outcome"] == "succeeded"


@given(st.floats(0, 4e9))
def test_a_float_becomes_the_nearest_nanosecond(value: float) -> None:
    assert abs(Fraction(value) * 10**9 - exact_ns(value)) <= Fraction(1, 2)


def test_a_time_that_multiplying_by_a_billion_gets_wrong_is_exact() -> None:
    value = 1689090425.5583751
    assert exact_ns(value) == 1689090425558375120
    assert exact_ns(value) != round(value * 1e9)


BAD: dict[str, Document] = {
    "NaN start": {"t_start": float("nan")},
    "infinite end": {"t_end": float("inf")},
    "no name": {"name": None},
    "empty agent": {"agent": ""},
    "a number for a recipe": {"recipe": 7},
    "an end before the start": {"t_end": 1.0},
    "a text for a time": {"t_start": "1689090425.5"},
    "true for a time": {"t_start": True},
    "a time beyond all clocks": {"t_end": 1e300},
    "an integer beyond all floats": {"t_end": 10**400},
    "a negative time": {"t_start": -5.0},
    "half a surrogate pair in a name": {"name": "pick\ud800"},
    "half a surrogate pair in a detail": {"date": {"$date": "\udfff"}},
}


@pytest.mark.parametrize("problem", BAD)
def test_a_bad_row_is_skipped_with_its_place_and_hides_no_other(problem: str, tmp_path: Path) -> None:
    source = dump(tmp_path / "dump.json", document(0), document(1, **BAD[problem]), document(2))
    found = import_mongo([source], tmp_path / "logs")
    assert [(one.code, one.path) for one in found.diagnostics] == [("skipped_row", str(source))]
    assert found.diagnostics[0].message.startswith("document 1: ")
    assert len(found.diagnostics[0].message) < 250
    assert found.n_executions == 2


@pytest.mark.parametrize("row", [None, 7, "text", [], {}, [[]]])
def test_a_row_that_is_no_document_is_skipped(row: object, tmp_path: Path) -> None:
    found = import_mongo([dump(tmp_path / "dump.json", document(0), row)], tmp_path / "logs")
    assert [one.code for one in found.diagnostics] == ["skipped_row"]
    assert found.n_executions == 1


@pytest.mark.parametrize(
    "name", ["t_start_planned", "t_end_planned", "duration_planned", "planning_time", "path_length"]
)
@pytest.mark.parametrize("value", [float("nan"), float("-inf"), "soon", True, 10**400])
def test_a_number_that_is_none_counts_as_unset_and_is_told(name: str, value: object, tmp_path: Path) -> None:
    source = dump(tmp_path / "dump.json", document(0, **{name: value}))
    found = import_mongo([source], tmp_path / "logs")
    assert [(one.code, one.path) for one in found.diagnostics] == [("non_finite_value", str(source))]
    assert name in found.diagnostics[0].message
    column = {"duration_planned": "planned_duration_s", "planning_time": "planning_time_s"}.get(name, name)
    row = only_row(tmp_path / "logs")
    assert row[{"t_start_planned": "planned_start_ns", "t_end_planned": "planned_end_ns"}.get(column, column)] is None


@pytest.mark.parametrize("value", [1e300, -1e300, 9e9])
def test_planned_times_beyond_the_clock_count_as_unset(value: float, tmp_path: Path) -> None:
    import_mongo([dump(tmp_path / "dump.json", document(0, t_start_planned=value))], tmp_path / "logs")
    assert only_row(tmp_path / "logs")["planned_start_ns"] is None


def test_missing_optional_facts_are_unset_without_a_word(tmp_path: Path) -> None:
    needed = ("name", "agent", "recipe", "t_start", "t_end", "outcome")
    bare = {name: value for name, value in document().items() if name in needed}
    found = import_mongo([dump(tmp_path / "dump.json", bare)], tmp_path / "logs")
    assert found.diagnostics == []
    row = only_row(tmp_path / "logs")
    assert (row["planned_start_ns"], row["path_length"], row["outcome"], row["task_type"]) == (
        None,
        None,
        "succeeded",
        "",
    )


def test_a_failed_execution_keeps_its_outcome_as_the_reason(tmp_path: Path) -> None:
    import_mongo([dump(tmp_path / "dump.json", document(0, outcome=3))], tmp_path / "logs")
    row = only_row(tmp_path / "logs")
    assert (row["outcome"], row["reason"]) == ("failed", "outcome 3")


def test_an_execution_of_no_length_starts_before_it_ends(tmp_path: Path) -> None:
    rows = [
        document(0),
        document(1, t_start=1_689_090_431.75, t_end=1_689_090_431.75),
        document(2, t_start=1_689_090_431.75),
    ]
    import_mongo([dump(tmp_path / "dump.json", *rows)], tmp_path / "logs")
    found = intervals(read_logs([tmp_path / "logs"]).events)
    assert found.height == 3
    assert found["end_ns"].null_count() == 0


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (b"not json", "no JSON"),
        (b"", "no JSON"),
        (b"\xff\xfe\x00", "no JSON"),
        (b"[" * 100_000, "no JSON"),
        (b"7", "a JSON int"),
        (b"null", "a JSON NoneType"),
        (json.dumps([{"agent": "R", "name": "pick", "counter": 7}]).encode(), "no task result"),
    ],
)
def test_a_file_that_is_no_dump_is_refused_by_name(content: bytes, found: str, tmp_path: Path) -> None:
    source = tmp_path / "dump.json"
    source.write_bytes(content)
    with pytest.raises(ImportDataError, match=found) as caught:
        import_mongo([source], tmp_path / "logs")
    assert str(caught.value).startswith(str(source))
    assert not (tmp_path / "logs").exists()


@pytest.mark.parametrize("name", ["task_durations.json", "task_synergies.json", "task_properties.json"])
def test_another_collection_is_refused_with_what_to_give_instead(name: str, data_dir: Path, tmp_path: Path) -> None:
    with pytest.raises(ImportDataError, match="give the task_results collection"):
        import_mongo([data_dir / "safety_areas" / name], tmp_path / "logs")


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ImportDataError, match="cannot be opened"):
        import_mongo([tmp_path / "nothing.json"], tmp_path / "logs")


def test_one_bad_source_hides_no_other(tmp_path: Path) -> None:
    good, bad = dump(tmp_path / "good.json", document(0)), tmp_path / "bad.json"
    bad.write_text("{")
    found = import_mongo([bad, good], tmp_path / "logs")
    assert (len(found.written), found.n_executions) == (1, 1)
    assert [(one.code, one.path) for one in found.diagnostics] == [("unreadable_file", str(bad))]


HOSTILE = [
    "../../up", "..", ".", "a/b\\c", "/etc/passwd", "ünïcødé", "盒子" * 200, "x" * 3000, "line\nbreak", "nul\0", "-o",
    " ", ".hidden", "a:b", "con. ", "*?", "🤖" * 100,
]  # fmt: skip


def test_hostile_recipe_names_stay_in_the_folder_and_come_back_whole(tmp_path: Path) -> None:
    folder = tmp_path / "logs"
    source = dump(tmp_path / "dump.json", *(document(number, recipe=name) for number, name in enumerate(HOSTILE)))
    found = import_mongo([source], folder)
    assert found.diagnostics == []
    assert {path.name for path in tmp_path.iterdir()} == {"dump.json", "logs"}
    assert len(list(folder.glob("*.mcap"))) == len(list(folder.iterdir())) == len(HOSTILE)
    starts = [read_log(path).events.filter(pl.col("kind") == "run_started") for path in found.written]
    assert {json.loads(start["details"][0])["name"] for start in starts} == set(HOSTILE)
    assert import_mongo([source], folder).written == []


@given(st.text(st.characters(exclude_categories=["Cs"]), min_size=1))
def test_any_recipe_has_a_file_name_of_its_own_that_a_file_system_takes(recipe: str) -> None:
    name = file_name("mongo", recipe)
    assert name
    assert not set(name) & set("/\\\0:\n")
    assert not name.startswith(".")
    assert len(name.encode()) <= 200
    assert (name == recipe) or file_name("mongo", recipe + "!") != name


def test_the_same_document_in_two_dumps_counts_once(tmp_path: Path) -> None:
    sources = [dump(tmp_path / name, document(0), document(1)) for name in ("a.json", "b.json")]
    found = import_mongo(sources, tmp_path / "logs")
    assert (found.n_executions, found.diagnostics) == (2, [])


def test_two_different_documents_with_one_id_are_told(tmp_path: Path) -> None:
    source = dump(tmp_path / "dump.json", document(0), document(0, t_end=1_689_090_427.0))
    found = import_mongo([source], tmp_path / "logs")
    assert found.n_executions == 1
    assert [one.code for one in found.diagnostics] == ["skipped_row"]


CHANGES = [{"t_end": 1_689_090_430.0}, {"path_length": 9.0}, {"outcome": 0}, {"duration_real": 1.0}, {"type": "place"}]


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: next(iter(change)))
def test_a_dump_that_has_changed_is_refused_and_nothing_is_written(change: Document, tmp_path: Path) -> None:
    folder = tmp_path / "logs"
    import_mongo([dump(tmp_path / "dump.json", document(0))], folder)
    before = snapshot(folder)
    source = dump(tmp_path / "dump.json", document(0, **change), document(1, recipe="another"))
    with pytest.raises(ImportDataError, match="the source has changed since"):
        import_mongo([source], folder)
    assert snapshot(folder) == before


def test_a_dump_that_has_grown_is_refused(tmp_path: Path) -> None:
    import_mongo([dump(tmp_path / "dump.json", document(0))], tmp_path / "logs")
    with pytest.raises(ImportDataError, match="a log of 4 events, expected 6"):
        import_mongo([dump(tmp_path / "dump.json", document(0), document(1))], tmp_path / "logs")


def test_a_log_of_another_run_under_the_same_name_is_refused(tmp_path: Path) -> None:
    import_mongo([dump(tmp_path / "dump.json", document(0, recipe="theirs"))], tmp_path / "logs")
    (tmp_path / "logs" / "theirs.mcap").rename(tmp_path / "logs" / "recipe_1.mcap")
    with pytest.raises(ImportDataError, match="a log of another run"):
        import_mongo([dump(tmp_path / "dump.json", document(0))], tmp_path / "logs")


def test_a_folder_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be made"):
        import_mongo([dump(tmp_path / "dump.json", document(0))], tmp_path / "file" / "logs")


def test_an_empty_dump_gives_nothing(tmp_path: Path) -> None:
    found = import_mongo([dump(tmp_path / "dump.json")], tmp_path / "logs")
    assert (found.written, found.diagnostics, found.n_executions) == ([], [], 0)


def test_progress_is_told_once_a_recipe(tmp_path: Path) -> None:
    told: list[Path] = []
    source = dump(tmp_path / "dump.json", document(0), document(1, recipe="recipe_2"))
    found = import_mongo([source], tmp_path / "logs", told.append)
    assert told == found.written


def test_the_order_of_the_documents_does_not_matter() -> None:
    rows = [document(number % 3, _id={"$oid": f"{number}"}, agent="HR"[number % 2]) for number in range(6)]
    assert run_events("recipe_1", rows) == run_events("recipe_1", rows[::-1])
