"""What is no log is told with the command that imports it, ready to be typed."""

from __future__ import annotations

import bz2
import gzip
import io
import json
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import polars as pl
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.cli.hints import import_line, shell_quoted
from hrclog.recorders.importers.heads import without_compression
from hrclog.recorders.importers.importers import IMPORTERS
from hrclog.recorders.importers.table.presets import preset_names, read_preset

Run = Callable[..., Any]

HINT = re.compile(r"; import it with `(hrclog import .*)`")
STUDY = "who,step,begin,end\nrobot,pick,2026-03-02T09:00:01Z,2026-03-02T09:00:05Z\n"
FRAME = pl.DataFrame(
    {"agent": ["robot", "human"], "task": ["pick", "place"], "start": [1.772e9, 1.773e9], "end": [1.7725e9, 1.7735e9]}
)
ROW = {"recipe": "monday_1", "agent": "robot", "name": "pick", "t_start": 1_780_000_000, "t_end": 1_780_000_004.5}
BORIS = (
    "Observation id\tSubject\tBehavior\tBehavior type\tTime\n"
    "bench\trobot\tpick\tSTART\t1.0\n"
    "bench\trobot\tpick\tSTOP\t2.5\n"
)
ELAN = (
    "task@robot\trobot\t00:00:01.000\t00:00:05.500\t00:00:04.500\tpick\n"
    "task@robot\trobot\t00:00:06.000\t00:00:07.500\t00:00:01.500\tplace\n"
)


def parquet(frame: pl.DataFrame) -> bytes:
    frame.write_parquet(stream := io.BytesIO())
    return stream.getvalue()


def arrow(frame: pl.DataFrame) -> bytes:
    frame.write_ipc(stream := io.BytesIO())
    return stream.getvalue()


def workbook(frame: pl.DataFrame) -> bytes:
    frame.write_excel(stream := io.BytesIO())
    return stream.getvalue()


IMPORTABLE = {
    "study.csv": (STUDY.encode(), "table {} -o logs"),
    "study.txt": (STUDY.replace(",", ";").encode("utf-16"), "table {} -o logs"),
    "lines.jsonl": (FRAME.write_ndjson().encode(), "table {} -o logs"),
    "array.json": (json.dumps(FRAME.to_dicts()).encode(), "table {} -o logs"),
    "study.parquet": (parquet(FRAME), "table {} -o logs"),
    "study.arrow": (arrow(FRAME), "table {} -o logs"),
    "boris.tsv": (BORIS.encode(), "table {} --preset boris -o logs"),
    "elan.txt": (ELAN.encode(), "table {} --preset elan -o logs"),
    "dump.json": (json.dumps([ROW]).encode(), "mongo {} -o logs"),
    "dump.json.gz": (gzip.compress(json.dumps([ROW], indent=2).encode()), "mongo {} -o logs"),
    "dump.json.zst": (zstandard.compress(json.dumps(ROW).encode()), "mongo {} -o logs"),
}

OTHERS = {
    "prose.txt": b"Dear all,\n\nplease find the data, as promised, in the folder.\n\nYours, A. Nonymous\n",
    "nested.json": b'{"resource": {"spans": []}}\n{"resource": {"spans": []}}\n',
    "picture.png": b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 4,
    "archive.zip": b"PK\x03\x04" + bytes(26) + b"a.txt" + bytes(90),
    "packed.bz2": bz2.compress(STUDY.encode()),
    "torn.gz": gzip.compress(STUDY.encode())[:14],
    "empty.csv": b"",
    "page.html": b"<!DOCTYPE html>\n<html><body>a, b, c</body></html>\n",
}


@pytest.mark.parametrize("name", IMPORTABLE)
def test_what_can_be_imported_is_told_with_the_line_that_does_it(
    name: str, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    content, expected = IMPORTABLE[name]
    monkeypatch.chdir(tmp_path)
    Path(name).write_bytes(content)
    result = run("analyze", name)
    [line] = HINT.findall(result.err)
    assert (result.code, line) == (1, f"hrclog import {expected.format(name)}")
    imported = run(*shlex.split(line)[1:])
    assert imported.code in (0, 3), imported.err
    assert run("info", "logs").code == 0


@pytest.mark.parametrize("name", OTHERS)
def test_what_no_importer_reads_is_told_without_one(name: str, run: Run, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(OTHERS[name])
    result = run("check", tmp_path / name)
    assert (result.code, HINT.findall(result.err)) == ((3, []) if name == "empty.csv" else (1, []))


def test_a_workbook_is_no_archive_to_be_unpacked(run: Run, tmp_path: Path) -> None:
    pytest.importorskip("xlsxwriter")
    (tmp_path / "study.xlsx").write_bytes(workbook(FRAME))
    result = run("check", tmp_path / "study.xlsx")
    assert "unpack it" not in result.err
    assert f"hrclog import table {tmp_path / 'study.xlsx'} -o logs" in result.err


@pytest.mark.parametrize("format_", ["samples/boris", "samples/elan", "samples/plansys2", "samples/table"])
def test_the_line_of_a_sample_imports_it(format_: str, run: Run, data_dir: Path, tmp_path: Path) -> None:
    folder = data_dir.parent / format_
    if not folder.is_dir():
        pytest.skip("no samples to read")
    for number, file in enumerate(sorted(folder.iterdir())):
        for line in HINT.findall(run("check", file).err):
            command = shlex.split(line.replace("-o logs", f"-o {tmp_path / str(number)}"))[1:]
            assert run(*command).code in (0, 3) or "preset" not in line


@pytest.mark.parametrize("name", preset_names())
def test_each_preset_of_text_files_is_known_by_its_columns(name: str) -> None:
    preset = read_preset(name)
    sign = "\t" if name.startswith(("elan", "boris")) else ","
    if preset.n_columns:
        times = {source.column for source in (preset.mapping.start, preset.mapping.end) if source}
        cells = ["1.5" if f"#{place}" in times else "word" for place in range(1, preset.n_columns + 1)]
        text = f"{sign.join(cells)}\n" * 3
    else:
        text = "".join(f"{sign.join(line)}\n" for line in (preset.columns, ["x"] * len(preset.columns)))
    arguments = IMPORTERS["table"].arguments_for(text.encode(), "export.txt")
    assert arguments == f"--preset {name.partition('-')[0]} -o logs"


def test_a_bag_without_events_is_told_how_to_begin(run: Run, samples: Path, tmp_path: Path) -> None:
    bag = tmp_path / "my bag"
    shutil.copytree(samples / "ros2_actions" / "tuesday", bag)
    line = f"hrclog import bag '{bag}' --suggest"
    assert line in run("check", bag).err
    assert [row["message"].count(line) for row in run("check", bag, "--json").json()["diagnostics"]] == [1]
    shutil.copy(samples / "single.mcap", tmp_path)
    beside = run("check", tmp_path)
    assert (beside.code, line in beside.err) == (0, True)
    shutil.copy(samples / "single.mcap", tmp_path / "log.bin")
    assert "hrclog import" not in run("check", tmp_path / "log.bin").err


def test_a_folder_without_logs_and_a_table_among_logs_are_told(run: Run, samples: Path, tmp_path: Path) -> None:
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "b.csv").write_text(STUDY)
    (tmp_path / "tables" / "a.txt").write_text("no table")
    line = f"hrclog import table {tmp_path / 'tables' / 'b.csv'} -o logs"
    for arguments in ([tmp_path / "tables"], [samples / "single.mcap", tmp_path / "tables" / "b.csv"]):
        result = run("check", *arguments)
        assert HINT.findall(result.err) == [line]
    both = run("check", tmp_path / "tables" / "b.csv", tmp_path / "tables" / "a.txt")
    assert HINT.findall(both.err) == [line]


def test_tables_of_a_folder_are_imported_together(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("P01", "P02"):
        folder = tmp_path / "my study" / "tables"
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{name}.csv").write_text(STUDY)
    [line] = HINT.findall(run("analyze", "my study").err)
    assert line == "hrclog import table 'my study/tables'/*.csv -o logs"
    script = line.replace("hrclog", f"{sys.executable} -m hrclog", 1)
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("2 runs, 2 executions")
    (folder / "notes.csv").write_bytes(b"\x00\x01")
    assert HINT.findall(run("analyze", "my study").err) == ["hrclog import table 'my study/tables/P01.csv' -o logs"]


def test_tables_of_results_are_not_to_be_imported(run: Run, samples: Path, tmp_path: Path) -> None:
    assert run("export", samples / "single.mcap", "-o", tmp_path, "--table", "runs").code == 0
    (tmp_path / "analysis.json").write_text("{}")
    for command in (["check"], ["view", "--run", "nobody"]):
        result = run(*command, tmp_path)
        assert (result.code, "hrclog import" in result.err) == (1, False)


def test_an_importer_that_fails_hides_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> str:
        raise RuntimeError("broken")

    (tmp_path / "study.csv").write_text(STUDY)
    monkeypatch.setattr(IMPORTERS["bag"], "arguments_for", fail, raising=False)
    assert import_line(tmp_path / "study.csv", logs_too=False).startswith("hrclog import table ")


def test_another_importer_is_named_where_it_fits(run: Run, samples: Path, tmp_path: Path) -> None:
    (tmp_path / "study.csv").write_text(STUDY)
    (tmp_path / "dump.json").write_text(json.dumps([ROW, ROW | {"agent": "human"}]))
    (tmp_path / "bad.csv").write_text("a,b\n1,2\n")
    bag = samples / "ros2_actions" / "tuesday" / "tuesday_0.mcap"
    for importer, file, line in (
        ("mongo", tmp_path / "study.csv", f"hrclog import table {tmp_path / 'study.csv'} -o logs"),
        ("table", bag, f"hrclog import bag {bag} --suggest"),
    ):
        result = run("import", importer, file, "-o", tmp_path / "logs")
        assert (result.code, HINT.findall(result.err)) == (1, [line])
    same = run("import", "table", tmp_path / "bad.csv", "-o", tmp_path / "logs")
    assert (same.code, HINT.findall(same.err)) == (1, [])


@settings(max_examples=200)
@given(st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), min_size=1))
def test_a_shell_takes_a_name_for_one_word(name: str) -> None:
    quoted = shell_quoted(name)
    assert quoted.isprintable()
    if name.isprintable():
        assert shlex.split(quoted) == [f"./{name}" if name.startswith("-") else name]


def test_bash_understands_names_that_cannot_be_printed() -> None:
    names = ["line\nbreak", "tab\t'quote'", "\x1b]0;t\x07", "b\\n\n", "ünï\n", "\udcff", "-\n", "$(touch x)", "a`b`"]
    script = "; ".join(f"printf '%s\\0' {shell_quoted(name)}" for name in names)
    printed = subprocess.run(["bash", "-c", script], capture_output=True, check=True).stdout
    shown = printed.decode(errors="surrogateescape").split("\0")[:-1]
    assert shown == [f"./{name}" if name.startswith("-") else name for name in names]


@settings(max_examples=200)
@given(
    st.one_of(st.binary(max_size=300), st.text(max_size=200).map(str.encode)), st.sampled_from(["a.csv", "b", "c.json"])
)
def test_importers_answer_to_any_bytes(content: bytes, name: str) -> None:
    for importer in IMPORTERS.values():
        for head in (content, gzip.compress(content), b"PAR1" + content, b"[{" + content):
            assert isinstance(importer.arguments_for(head, name), str | None)


def test_little_that_unpacks_to_much_costs_little() -> None:
    for packed in (gzip.compress(bytes(1 << 24)), zstandard.compress(bytes(1 << 24))):
        assert len(without_compression(packed)) <= 1 << 16


def test_an_importer_that_cannot_be_loaded_hides_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "study.csv").write_text(STUDY)
    monkeypatch.setattr(IMPORTERS, "_paths", {"gone": "no_such_module:Gone", **IMPORTERS._paths})
    assert import_line(tmp_path / "study.csv", logs_too=False).startswith("hrclog import table ")


def test_help_and_hints_load_nothing_heavy(tmp_path: Path) -> None:
    (tmp_path / "study.csv").write_text(STUDY)
    code = """if True:
        import sys
        from pathlib import Path
        from hrclog.cli import main
        for arguments in (["import", "--help"], ["import", "table", "--help"], ["import", "bag", "--help"]):
            assert main(arguments) == 0
        from hrclog.recorders.importers.importers import IMPORTERS
        head = Path("study.csv").read_bytes()
        assert [name for name in IMPORTERS if IMPORTERS[name].arguments_for(head, "study.csv")] == ["table"]
        assert not {"polars", "numpy", "mcap", "pandas"} & set(sys.modules)
    """
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, check=True)


def test_a_log_that_an_import_finds_there_is_not_to_be_imported(run: Run, tmp_path: Path) -> None:
    study, logs = tmp_path / "study.csv", tmp_path / "logs"
    study.write_text(STUDY)
    assert run("import", "table", study, "-o", logs).code == 0
    study.write_text(STUDY.replace("05Z", "06Z"))
    refused = run("import", "table", study, "-o", logs)
    assert "the source has changed since" in refused.err
    assert "hrclog import" not in refused.err
