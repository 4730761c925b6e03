"""Tables become logs: the same facts in every format and form, and bad rows hide no others."""

from __future__ import annotations

import json
from datetime import date
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from polars.testing import assert_frame_equal

from hrclog.analyzers.projections.intervals import intervals
from hrclog.errors import HrclogError, ImportDataError
from hrclog.log.reader import read_events
from hrclog.recorders.importers.importer import Imported
from hrclog.recorders.importers.table.importer import TableImporter
from hrclog.recorders.importers.writing import import_files

T0 = 1_772_442_000
FACTS = pl.DataFrame(
    [
        ("P01", "c1", "robot", "pick", T0 + 1.0, T0 + 5.5, "succeeded"),
        ("P01", "c1", "human", "screw; tight", T0 + 0.5, T0 + 6.25, "failed"),
        ("P01", "c1", "robot", 'put "here"', T0 + 5.5, T0 + 9.0, "succeeded"),
        ("P02", "c1", "human", "schöne Sache", T0 + 100.25, T0 + 104.875, "canceled"),
        ("P02", "c1", "robot", "pick", T0 + 101.0, None, None),
    ],
    schema=["participant", "condition", "agent", "task", "start", "end", "outcome"],
    orient="row",
)


def run_import(source: Path, folder: Path | None = None, **options: Any) -> Imported:  # noqa: ANN401 - options
    return import_files(TableImporter(), [source], folder, **options)


def written(path: Path, text: str, encoding: str = "utf-8") -> Path:
    path.write_bytes(text.encode(encoding))
    return path


def facts_of(folder: Path) -> pl.DataFrame:
    names = ("agent", "task", "start_ns", "end_ns", "outcome", "reason", "attempt")
    return intervals(read_events(folder)).select(names).sort("start_ns", "agent", "task")


def save(frame: pl.DataFrame, path: Path) -> Path:
    match path.suffix:
        case ".parquet":
            frame.write_parquet(path)
        case ".arrow":
            frame.write_ipc(path)
        case ".jsonl":
            frame.write_ndjson(path)
        case ".json":
            path.write_text(json.dumps(frame.to_dicts()))
        case ".tsv":
            frame.write_csv(path, separator="\t")
        case ".xlsx":
            frame.write_excel(path)
        case _:
            frame.write_csv(path)
    return path


@pytest.mark.parametrize("ending", ["tsv", "parquet", "arrow", "jsonl", "json", "xlsx"])
def test_every_format_says_the_same(ending: str, tmp_path: Path) -> None:
    for name in ("csv", ending):
        run_import(save(FACTS, tmp_path / f"study.{name}"), tmp_path / f"logs {name}")
    expected, found = (read_events(tmp_path / f"logs {name}").drop("path") for name in ("csv", ending))
    assert_frame_equal(found, expected)
    assert facts_of(tmp_path / "logs csv")["start_ns"][0] == T0 * 10**9 + 500_000_000


@settings(max_examples=12)
@given(
    sign=st.sampled_from(",;\t|"), encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "cp1252"]),
    ending=st.sampled_from(["\n", "\r\n"]), has_comma=st.booleans(),
)  # fmt: skip
def test_delimiter_encoding_and_decimal_sign_are_found(
    tmp_path_factory: pytest.TempPathFactory, sign: str, encoding: str, ending: str, has_comma: bool
) -> None:
    folder = tmp_path_factory.mktemp("text")
    frame = FACTS.with_columns(pl.col("start", "end").cast(pl.String))
    if has_comma:
        frame = frame.with_columns(pl.col("start", "end").str.replace(".", ",", literal=True))
    text = frame.write_csv(separator=sign, line_terminator=ending)
    run_import(written(folder / "a.csv", text, encoding), folder / "a")
    assert_frame_equal(facts_of(folder / "a"), expected_facts(folder))


EXPECTED: list[pl.DataFrame] = []


def expected_facts(folder: Path) -> pl.DataFrame:
    if not EXPECTED:
        run_import(save(FACTS, folder / "b.csv"), folder / "b")
        EXPECTED.append(facts_of(folder / "b"))
    return EXPECTED[0]


def event_form(frame: pl.DataFrame) -> pl.DataFrame:
    facts = pl.all().exclude("start", "end", "outcome")
    starts = frame.select(
        facts,
        pl.lit("start").alias("lifecycle"),
        pl.col("start").alias("time"),
        pl.lit(None, pl.String).alias("outcome"),
    )
    ends = frame.filter(pl.col("end").is_not_null()).select(
        facts, pl.lit("complete").alias("lifecycle"), pl.col("end").alias("time"), "outcome"
    )
    return pl.concat([starts, ends]).sort("time", "lifecycle")


def test_a_row_per_event_says_the_same_as_a_row_per_execution(tmp_path: Path) -> None:
    run_import(save(FACTS, tmp_path / "a.csv"), tmp_path / "a")
    run_import(save(event_form(FACTS), tmp_path / "b.csv"), tmp_path / "b")
    assert_frame_equal(facts_of(tmp_path / "a"), facts_of(tmp_path / "b"))


def test_dates_that_do_not_show_their_order_are_read_as_those_of_other_files_show(tmp_path: Path) -> None:
    head = "agent,task,start,end\n"
    for day in (3, 4, 25):
        text = f"{head}robot,pick,{day:02}/02/2026 09:00:00,{day:02}/02/2026 09:00:05\n"
        (tmp_path / f"{day:02}.csv").write_text(text)
    sources = [tmp_path / "03.csv", tmp_path / "04.csv", tmp_path / "25.csv"]
    imported = import_files(TableImporter(), sources, tmp_path / "logs")
    assert (imported.runs, imported.diagnostics) == (["03", "04", "25"], [])
    days = intervals(read_events(tmp_path / "logs")).sort("start_ns")["start_ns"] // (86_400 * 10**9)
    assert days.to_list() == [(date(2026, 2, day) - date(1970, 1, 1)).days for day in (3, 4, 25)]
    (tmp_path / "us.csv").write_text(f"{head}robot,pick,02/26/2026 09:00:00,02/26/2026 09:00:05\n")
    both = import_files(TableImporter(), [*sources, tmp_path / "us.csv"], tmp_path / "both")
    assert (both.runs, [Path(found.path).name for found in both.diagnostics]) == (["25", "us"], ["03.csv", "04.csv"])


def test_importing_twice_adds_nothing_and_a_changed_row_is_told(tmp_path: Path) -> None:
    source = save(FACTS, tmp_path / "study.csv")
    first = run_import(source, tmp_path / "logs")
    assert (len(first.written), first.runs) == (2, ["P01_c1", "P02_c1"])
    more = pl.concat([FACTS, FACTS.head(1).with_columns(participant=pl.lit("P03"))])
    second = run_import(save(more, source), tmp_path / "logs")
    assert [path.stem for path in second.written] == ["P03_c1"]
    changed = FACTS.with_columns(end=pl.col("end") + 1)
    with pytest.raises(ImportDataError, match="task_ended of 'robot', 'pick'"):
        run_import(save(changed, source), tmp_path / "logs")


def test_runs_have_names_and_tags_of_their_columns(tmp_path: Path) -> None:
    run_import(save(FACTS, tmp_path / "study.csv"), tmp_path / "logs", tag=("lab=Brescia",))
    starts = read_events(tmp_path / "logs").filter(pl.col("kind") == "run_started")
    details = [json.loads(text) for text in starts["details"]]
    assert sorted((entry["name"], entry["tags"]["participant"]) for entry in details) == [
        ("P01_c1", "P01"),
        ("P02_c1", "P02"),
    ]
    assert all(entry["tags"] | {"condition": "c1", "lab": "Brescia"} == entry["tags"] for entry in details)


BAD = """run,agent,task,start,end,outcome
r,robot,pick,2026-03-02T09:00:00Z,2026-03-02T09:00:05Z,succeeded
r,robot,pick,2026-03-02T09:00:09Z,2026-03-02T09:00:05Z,succeeded
r,human,screw,2026-03-02T09:00:01Z,NaN,succeeded
r,robot,pick,2026-03-02T09:00:00Z,2026-03-02T09:00:05Z,succeeded
r,human,screw,2026-03-02T09:00:01,2026-03-02T09:00:03Z,succeeded
r,human,,2026-03-02T09:00:01Z,2026-03-02T09:00:03Z,succeeded
r,human,screw,2026-03-02T09:00:02Z,2026-03-02T09:00:06Z,fine
r,human,screw,2026-03-02T09:00:03Z,2026-03-02T09:00:07Z,
r,hum"""


def test_bad_rows_are_counted_and_listed_and_the_others_go_in(tmp_path: Path) -> None:
    imported = run_import(written(tmp_path / "bad.csv", BAD), tmp_path / "logs")
    assert [(skip["line"]) for skip in imported.reading.values["skipped"]] == [3, 4, 5, 6, 7, 10]
    (skipped,) = [finding for finding in imported.diagnostics if finding.code == "skipped_row"]
    assert skipped.message.startswith("6 rows skipped")
    others = sorted(finding.code for finding in imported.diagnostics if finding.code != "skipped_row")
    assert others == ["outcome_not_told", "self_overlap", "unknown_outcome"]
    assert facts_of(tmp_path / "logs")["outcome"].to_list() == ["succeeded", "unknown", "unknown"]
    explained = run_import(tmp_path / "bad.csv", ok=("fine",))
    assert "unknown_outcome" not in [finding.code for finding in explained.diagnostics]


def test_events_that_do_not_pair_are_skipped_and_pauses_are_kept(tmp_path: Path) -> None:
    rows = ["who,what,event,time", "r,a,stop,1", "r,a,start,2", "r,a,pause,3", "r,a,resume,5", "r,a,stop,8"]
    rows += ["r,b,start,9", "r,b,stop,9", "r,c,wave,10", "r,d,start,11"]
    source = written(tmp_path / "e.csv", "\n".join(rows))
    imported = run_import(source, tmp_path / "logs", agent="who", task="what", unit="s")
    assert [skip["line"] for skip in imported.reading.values["skipped"]] == [2, 9]
    found = intervals(read_events(tmp_path / "logs")).select("task", "start_ns", "end_ns", "paused_ns").rows()
    s = 10**9
    assert found == [("a", 2 * s, 8 * s, 2 * s), ("b", 9 * s, 9 * s, 0), ("d", 11 * s, None, 0)]


REFUSED: dict[str, tuple[str, dict[str, Any], str]] = {
    "an unknown column": ("agent,task,start,end\nr,t,1,2\n", {"agent": "agnt"}, "did you mean 'agent'"),
    "two columns for one thing": ("agent,task,begin,start_time,end\nr,t,1,1,2\n", {}, "each be the start"),
    "no column for a thing": ("x,y\n1,2\n", {}, "--start"),
    "a header alone": ("agent,task,start,end\n", {}, "no row"),
    "no byte": ("", {}, "an empty file"),
    "times of hours if they were seconds": ("agent,task,start,end\nr,t,1000,90000\nr,t,95000,180000\n", {}, "--unit"),
    "an unknown zone": ("agent,task,start,end\nr,t,1,2\n", {"timezone": "Mars/Base"}, "Europe/Rome"),
    "one word with two meanings": ("agent,task,start,end\nr,t,1,2\n", {"ok": ("x",), "failed": ("x",)}, "--failed"),
    "no good row": ("agent,task,start,end\nr,,1,2\n", {}, "no task"),
    "a preset of other columns": ("agent,task,start,end\nr,t,1,2\n", {"preset": "boris"}, "Behavior"),
    "an unknown preset": ("agent,task,start,end\nr,t,1,2\n", {"preset": "borsi"}, "boris, elan"),
}  # fmt: skip


@pytest.mark.parametrize("problem", REFUSED)
def test_what_cannot_be_read_is_refused_with_what_to_do(problem: str, tmp_path: Path) -> None:
    text, options, told = REFUSED[problem]
    with pytest.raises(HrclogError, match=told):
        run_import(written(tmp_path / "bad.csv", text), tmp_path / "logs", **options)
    assert not (tmp_path / "logs").exists()


def test_a_binary_file_and_a_missing_one_hide_no_other(tmp_path: Path) -> None:
    (tmp_path / "bad.bin").write_bytes(bytes(range(256)) * 9)
    sources = [tmp_path / "bad.bin", save(FACTS, tmp_path / "good.csv"), tmp_path / "missing.csv"]
    imported = import_files(TableImporter(), sources, tmp_path / "logs")
    assert [finding.code for finding in imported.diagnostics].count("unreadable_file") == 2
    assert len(imported.written) == 2


def test_a_wide_table_costs_its_mapped_columns(tmp_path: Path) -> None:
    names = ",".join(f"x{number}" for number in range(50_000))
    source = written(tmp_path / "wide.csv", f"agent,task,start,end,{names}\nr,t,1,2{',7' * 50_000}\n")
    assert run_import(source).n_executions == 1
    with pytest.raises(ImportDataError, match="and 49,964 more"):
        run_import(source, agent="nobody")


def test_hostile_names_are_kept_and_stay_in_their_folder(tmp_path: Path) -> None:
    name = "../../up\x1b[31m\0"
    rows = pl.DataFrame(
        {"run": [name], "agent": ["<img onerror=1>"], "task": ["=cmd()\nnext"], "start": [1.0], "end": [2.0]}
    )
    imported = run_import(save(rows, tmp_path / "x.csv"), tmp_path / "logs")
    assert imported.runs == [name]
    assert [path.parent for path in imported.written] == [tmp_path / "logs"]
    assert facts_of(tmp_path / "logs").select("agent", "task").rows() == [("<img onerror=1>", "=cmd()\nnext")]
