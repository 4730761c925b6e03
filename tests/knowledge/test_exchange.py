"""Files and MongoDB documents: upstream's shapes, and nothing is lost on the way back."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from bson import ObjectId
from kb_mongo import FakeDatabase
from kb_reads import durations, results
from kb_runs import frame_of_runs, state

from hrclog.analyzers.learning.ingest import ingest, ingest_logs, update_statistics
from hrclog.analyzers.projections.schemas import DURATIONS, INTERVALS, SYNERGIES
from hrclog.cli.kb_import import import_folder
from hrclog.errors import ImportDataError, KnowledgeError, OutputError
from hrclog.knowledge import open_knowledge
from hrclog.knowledge.base import KnowledgeBase
from hrclog.knowledge.exchange import export_json, export_parquet
from hrclog.knowledge.mongo import export_mongo, write_documents
from hrclog.recorders.importers.mongo import import_mongo

pytestmark = pytest.mark.slow  # each test fills several knowledge bases

SAMPLES = Path(__file__).parents[2] / "sample_logs"
COLLECTIONS = ("task_properties", "task_results", "task_durations", "task_synergies")


@pytest.fixture
def kb(where: str) -> Any:  # noqa: ANN401 - a generator of a knowledge base
    with open_knowledge(where, create=True) as opened:
        ingest_logs(opened, [SAMPLES / "campaign", SAMPLES / "failures.mcap", SAMPLES / "killed.mcap.partial"])
        ingest(opened, frame_of_runs(range(3)))
        opened.withdraw("n1", "why not")
        update_statistics(opened)
        yield opened


def keys(documents: list[dict[str, Any]]) -> set[tuple[str, ...]]:
    return {tuple(document) for document in documents}


def test_what_is_exported_and_imported_is_the_same_to_the_last_bit(kb: KnowledgeBase, tmp_path: Path) -> None:
    export_json(kb, tmp_path / "files")
    with open_knowledge(tmp_path / "copy.sqlite", create=True) as copy:
        found, method = import_folder(copy, tmp_path / "files")
        assert len(found.added) == len(kb.runs())
        update_statistics(copy, *method)
        assert state(copy) == state(kb)
        assert import_folder(copy, tmp_path / "files")[0].added == []
        assert state(copy) == state(kb)


def test_statistics_keep_their_estimator_on_the_way(tmp_path: Path) -> None:
    with (
        open_knowledge(tmp_path / "a.sqlite", create=True) as kb,
        open_knowledge(tmp_path / "b.sqlite", create=True) as b,
    ):
        ingest(kb, frame_of_runs(range(4)))
        update_statistics(kb, "ols", "isolation-forest")
        export_json(kb, tmp_path / "files")
        update_statistics(b, *import_folder(b, tmp_path / "files")[1])
        assert state(b) == state(kb)


def test_documents_have_the_fields_of_the_authors_dumps(kb: KnowledgeBase, data_dir: Path, tmp_path: Path) -> None:
    export_json(kb, tmp_path)
    for name in COLLECTIONS:
        theirs = json.loads((data_dir / "safety_areas" / f"{name}.json").read_text())
        ours = json.loads((tmp_path / f"{name}.json").read_text())
        assert keys(ours) == {(*fields, "hrclog") for fields in keys(theirs)}, name
        for field, value in theirs[0].items():
            assert _shape(value) in {_shape(document[field]) for document in ours}, (name, field)


def _shape(value: Any) -> Any:  # noqa: ANN401 - any JSON value
    if isinstance(value, dict):
        return tuple((name, _shape(inner)) for name, inner in value.items())
    return "number" if isinstance(value, int | float) else type(value).__name__


def test_the_authors_importer_reads_our_task_results(kb: KnowledgeBase, tmp_path: Path) -> None:
    export_json(kb, tmp_path / "files")
    found = import_mongo([tmp_path / "files" / "task_results.json"], tmp_path / "logs")
    assert found.n_executions == results(kb).height
    assert len(found.runs) == results(kb)["run_id"].n_unique()


def test_the_published_durations_come_out_of_the_authors_results(data_dir: Path, tmp_path: Path) -> None:
    folder = data_dir / "safety_areas"
    published = json.loads((folder / "task_durations.json").read_text())
    with open_knowledge(tmp_path / "kb.sqlite", create=True) as kb:
        import_folder(kb, folder)
        update_statistics(kb, "paper")
        ours = {(row["agent"], row["task"]): row for row in durations(kb).iter_rows(named=True)}
        assert {task.task: task.targets for task in kb.properties()}["pick_blue_box"] == ("blue_box",)
        export_json(kb, tmp_path / "files")
    assert len(published) == 8
    pairs = {"counter": "count", "min": "min_s", "max": "max_s", "expected_duration": "mean_s", "median": "median_s"}
    for document in published:
        row = ours[document["agent"], document["name"]]
        for theirs, name in {**pairs, "duration_stddev": "std_s", "success_rate": "success_rate"}.items():
            assert row[name] == pytest.approx(document[theirs], abs=1e-8, rel=0), (document["_id"], name)
    again = {str(d["_id"]): d for d in json.loads((tmp_path / "files" / "task_durations.json").read_text())}
    for document in published:
        assert again[str(document["_id"])]["median"] == pytest.approx(document["median"], abs=1e-8, rel=0)


def test_the_authors_results_keep_their_times_on_the_way(data_dir: Path, tmp_path: Path) -> None:
    with open_knowledge(tmp_path / "kb.sqlite", create=True) as kb:
        import_folder(kb, data_dir / "safety_areas")
        export_json(kb, tmp_path / "files")
    theirs = json.loads((data_dir / "safety_areas" / "task_results.json").read_text())
    ours = json.loads((tmp_path / "files" / "task_results.json").read_text())
    fields = ("recipe", "agent", "name", "type", "outcome", "t_start", "t_end", "duration_planned", "path_length")
    assert sorted(tuple(d[name] for name in fields) for d in ours) == sorted(
        tuple(d[name] for name in fields) for d in theirs
    )


def test_parquet_files_are_the_frames(kb: KnowledgeBase, tmp_path: Path) -> None:
    written = export_parquet(kb, tmp_path)
    frames = {path.stem: pl.read_parquet(path) for path, _ in written}
    assert set(frames) == {*COLLECTIONS, "runs"}
    assert frames["task_results"].equals(results(kb).drop("path"))
    assert frames["task_durations"].schema == DURATIONS
    assert frames["task_synergies"].schema == SYNERGIES
    assert [*frames["task_results"].columns, "path"] == INTERVALS.names()
    assert frames["runs"]["withdrawn"].drop_nulls().to_list() == ["why not"]


def test_two_runs_of_one_name_are_two_recipes(tmp_path: Path) -> None:
    events = frame_of_runs([1])
    other = events.with_columns(pl.lit("run-other").alias("run_id"))
    with open_knowledge(tmp_path / "kb.sqlite", create=True) as kb:
        ingest(kb, pl.concat([events, other]))
        export_json(kb, tmp_path)
    documents = json.loads((tmp_path / "task_results.json").read_text())
    assert {document["recipe"] for document in documents} == {"n1 run-0001", "n1 run-other"}


def test_folders_that_cannot_be_imported_say_why(tmp_path: Path) -> None:
    with open_knowledge(tmp_path / "kb.sqlite", create=True) as kb:
        ingest(kb, frame_of_runs([1]))
        export_json(kb, tmp_path / "files")
        with pytest.raises(ImportDataError, match=r"task_results\.json"):
            import_folder(kb, tmp_path / "nowhere")
        rest = json.loads((tmp_path / "files" / "hrclog.json").read_text())
        for broken, words in (
            ({**rest, "schema_version": "0"}, "schema version '0'"),
            ({**rest, "runs": [{}]}, "KeyError"),
            ({**rest, "runs": [{**rest["runs"][0], "n_executions": 3}]}, "not whole"),
            ([], "TypeError"),
        ):
            (tmp_path / "files" / "hrclog.json").write_text(json.dumps(broken))
            with pytest.raises(ImportDataError, match=words):
                import_folder(kb, tmp_path / "files")
        (tmp_path / "files" / "hrclog.json").write_text("{")
        with pytest.raises(ImportDataError, match="no JSON"):
            import_folder(kb, tmp_path / "files")
        (tmp_path / "taken").write_text("a file")
        for export in (export_json, export_parquet):
            with pytest.raises(OutputError, match="taken"):
                export(kb, tmp_path / "taken")


def test_mongodb_gets_the_documents_of_the_files(kb: KnowledgeBase, tmp_path: Path) -> None:
    export_json(kb, tmp_path)
    database = FakeDatabase()
    counts = write_documents(kb, database, ObjectId)  # type: ignore[arg-type] - a stand-in
    for name in COLLECTIONS:
        files = json.loads((tmp_path / f"{name}.json").read_text())
        kept = list(database[name].documents.values())
        assert counts[name] == len(files) == len(kept)
        assert keys(kept) == keys(files)
    assert isinstance(next(iter(database["task_results"].documents.values()))["_id"], ObjectId)
    assert database["task_results"].calls == 2 * len(set(results(kb)["run_id"])) + 1


def test_writing_to_mongodb_twice_changes_nothing_and_leaves_others_documents_alone(kb: KnowledgeBase) -> None:
    database = FakeDatabase()
    theirs = {"_id": ObjectId(), "name": "theirs", "recipe": "x"}
    for name in COLLECTIONS:
        database[name].documents["theirs"] = theirs
    write_documents(kb, database, ObjectId)  # type: ignore[arg-type] - a stand-in
    before = {name: dict(database[name].documents) for name in COLLECTIONS}
    write_documents(kb, database, ObjectId)  # type: ignore[arg-type] - a stand-in
    assert {name: database[name].documents for name in COLLECTIONS} == before
    kb.withdraw("n2")
    update_statistics(kb)
    write_documents(kb, database, ObjectId)  # type: ignore[arg-type] - a stand-in
    kept = database["task_results"].documents
    assert kept["theirs"] == theirs
    assert len(kept) == len(before["task_results"]) - 4
    assert "n2" not in {document["recipe"] for document in kept.values()}


def test_a_mongodb_that_cannot_be_reached_is_told_without_its_password(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with open_knowledge(tmp_path / "kb.sqlite", create=True) as kb:
        for url in ("mongodb://me:s3cret@127.0.0.1:1/db?serverSelectionTimeoutMS=100", "mongodb://h:x/db", "http://x"):
            with pytest.raises(KnowledgeError, match="the server failed") as caught:
                export_mongo(kb, url)
            assert "s3cret" not in str(caught.value)
        monkeypatch.setitem(sys.modules, "pymongo", None)
        with pytest.raises(KnowledgeError, match=r"pip install 'hrclog\[mongo\]'"):
            export_mongo(kb, "mongodb://h/db")
