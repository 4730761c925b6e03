"""Whatever is wrong with a place, one error says what was found and what to do."""

from __future__ import annotations

import os
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from contextlib import closing
from pathlib import Path

import psycopg
import pytest
from kb_postgres import PASSWORD, Server
from kb_reads import results
from kb_runs import frame_of_runs
from sqlalchemy import update

from hrclog.analyzers.learning.ingest import ingest, update_statistics
from hrclog.errors import KnowledgeError
from hrclog.knowledge import open_knowledge
from hrclog.knowledge.database import _LOCK
from hrclog.knowledge.tables import META


def refusal(where: object, *, create: bool = False) -> str:
    with pytest.raises(KnowledgeError) as caught, open_knowledge(str(where), create=create):
        pass
    return str(caught.value)


@pytest.fixture
def made(where: str) -> str:
    """Return a place with three runs and their statistics."""
    with open_knowledge(where, create=True) as kb:
        ingest(kb, frame_of_runs(range(3)))
        update_statistics(kb, "paper")
    return where


def test_reading_makes_nothing(where: str, tmp_path: Path) -> None:
    assert "found no knowledge base; correct the name, or make one with: hrclog kb update" in refusal(where)
    assert list(tmp_path.iterdir()) == []


def test_an_empty_file_may_become_a_knowledge_base(tmp_path: Path) -> None:
    path = tmp_path / "kb.sqlite"
    path.touch()
    assert "found no knowledge base" in refusal(path)
    with open_knowledge(path, create=True) as kb:
        assert kb.runs() == []


def test_another_schema_version_is_not_read(made: str) -> None:
    with open_knowledge(made) as kb, kb.writing() as connection:
        connection.execute(update(META).values(value="0"))
    assert "schema version 0, expected 1; use the hrclog that made it" in refusal(made, create=True)


@pytest.mark.parametrize("create", [False, True])
def test_what_is_no_knowledge_base_is_not_touched(tmp_path: Path, create: bool) -> None:
    text = tmp_path / "notes.txt"
    text.write_text("some notes that somebody needs\n" * 99)
    assert "no SQLite database" in refusal(text, create=create)
    assert text.read_text() == "some notes that somebody needs\n" * 99
    other = tmp_path / "other.sqlite"
    with sqlite3.connect(other) as connection:
        connection.execute("CREATE TABLE music (title)")
    connection.close()
    before = other.read_bytes()
    assert "a database of something else (tables music)" in refusal(other, create=create)
    assert other.read_bytes() == before
    assert "found a folder" in refusal(tmp_path, create=create)


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    assert f"there is no folder {tmp_path / 'no'}" in refusal(tmp_path / "no" / "kb.sqlite", create=True)


def test_a_damaged_file_is_told_apart_from_a_bug(tmp_path: Path) -> None:
    path = tmp_path / "kb.sqlite"
    with open_knowledge(path, create=True) as kb:
        ingest(kb, frame_of_runs(range(30)))
    data = bytearray(path.read_bytes())
    data[4096:] = b"\x55" * (len(data) - 4096)
    path.write_bytes(data)
    with pytest.raises(KnowledgeError, match="damaged"), open_knowledge(path) as kb:
        results(kb)


def test_tables_of_others_in_a_schema_are_left_alone(postgres: str) -> None:
    with psycopg.connect(postgres) as connection:
        connection.execute("CREATE TABLE music (title text)")
    with open_knowledge(postgres, create=True) as kb:
        assert kb.runs() == []
    with psycopg.connect(postgres) as connection:
        assert connection.execute("SELECT count(*) FROM music").fetchone() == (0,)


def test_names_that_others_have_taken_are_not_written_over(postgres: str) -> None:
    with psycopg.connect(postgres) as connection:
        connection.execute("CREATE TABLE runs (distance text)")
    assert "a database of something else (tables runs)" in refusal(postgres, create=True)


def test_a_writer_that_does_not_end_is_not_waited_for_for_ever(made: str) -> None:
    with open_knowledge(made, wait_s=0.2) as kb:
        if made.startswith("postgres"):
            holder = psycopg.connect(made)
            holder.execute("SELECT pg_advisory_xact_lock(%s)", [_LOCK])
        else:
            holder = sqlite3.connect(made, isolation_level=None)  # type: ignore[assignment] - either has execute
            holder.execute("BEGIN IMMEDIATE")
        with pytest.raises(KnowledgeError, match="another process is writing"):
            ingest(kb, frame_of_runs([7]))
        assert len(kb.runs()) == 3  # reading goes on
        holder.rollback()
        holder.close()
        assert ingest(kb, frame_of_runs([7])).added == ["run-0007"]


def test_servers_that_cannot_be_used_are_told_apart_and_no_password_is_shown(server: Server) -> None:
    cases = {
        server.url("nothing"): "no such database or user",
        server.url("postgres", "wrong-word"): "user or password are wrong",
        server.url("postgres").replace(str(server.port), "1"): "the server cannot be reached",
        "mysql://me:wrong-word@host/db": "expected a file",
        "mongodb://me:wrong-word@host/db": "can only be written to",
        "postgresql://me:wrong-word@host": "expected a file",
        "://": "not a database URL",
        "sqlite://": "expected a file",
    }
    for url, words in cases.items():
        said = refusal(url, create=True)
        assert words in said
        assert "wrong-word" not in said
        assert PASSWORD not in said


def test_a_server_that_comes_back_is_used_again(server: Server, postgres: str) -> None:
    with open_knowledge(postgres, create=True) as kb:
        server.stop()
        with pytest.raises(KnowledgeError, match="server cannot be reached"):
            ingest(kb, frame_of_runs([1]))
        server.start()
        assert ingest(kb, frame_of_runs([1])).added == ["run-0001"]


def test_a_missing_driver_is_named_with_its_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "psycopg", None)
    assert "pip install 'hrclog[postgres]'" in refusal("postgresql://me@host/db")


READ_ONLY = """
import sys
from kb_reads import results
from kb_runs import frame_of_runs
from hrclog.analyzers.learning.ingest import ingest
from hrclog.errors import KnowledgeError
from hrclog.knowledge import open_knowledge
with open_knowledge(sys.argv[1]) as kb:
    print(len(kb.runs()), len(kb.times().times), results(kb).height)
    try:
        ingest(kb, frame_of_runs([9]))
    except KnowledgeError as error:
        print(error)
try:
    open_knowledge(sys.argv[2], create=True)
except KnowledgeError as error:
    print(error)
"""


def test_what_can_only_be_read_is_read_and_not_written(tmp_path: Path) -> None:
    folder = tmp_path / "shelf"
    folder.mkdir()
    path = folder / "kb.sqlite"
    with open_knowledge(path, create=True) as kb:
        ingest(kb, frame_of_runs(range(3)))
        update_statistics(kb, "paper")
    for each in (path, folder):
        each.chmod(0o555)
    helpers = str(Path(__file__).parents[1] / "helpers")
    command = [sys.executable, "-c", READ_ONLY, str(path), str(folder / "new.sqlite")]
    drop = ["--reuid=65534", "--regid=65534", "--clear-groups", "--inh-caps=-all", "--bounding-set=-all"]
    if os.getuid() == 0:
        above = [parent for parent in tmp_path.parents if Path(tempfile.gettempdir()) in parent.parents]
        for parent in (tmp_path, *above):
            parent.chmod(0o755)
        command = [shutil.which("setpriv") or "setpriv", *drop, *command]
    environment = os.environ | {"PYTHONPATH": helpers, "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, cwd="/")
    folder.chmod(0o755)
    counts, unwritten, unmade = done.stdout.splitlines() or [done.stderr] * 3
    assert counts == "3 4 12"
    assert "it can only be read" in unwritten
    assert "it cannot be opened" in unmade


def test_times_that_hrclog_did_not_write_are_told_with_the_file_and_the_remedy(tmp_path: Path) -> None:
    path = tmp_path / "kb.sqlite"
    with open_knowledge(path, create=True) as kb:
        ingest(kb, frame_of_runs(range(2)))
        update_statistics(kb, "paper")
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("UPDATE task_times SET value = '{\"a\": 1}'")
        connection.commit()
    with open_knowledge(path) as kb, pytest.raises(KnowledgeError, match=r"kb\.sqlite.*hrclog kb rebuild"):
        kb.times()
