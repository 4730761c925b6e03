"""The other verbs, and what all verbs share."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from mcap.opcode import Opcode

import hrclog
from hrclog.analyzers.output import TABLES
from hrclog.cli import VERBS
from hrclog.cli.export import TABLES as EXPORTED
from hrclog.log.mcap.records import Walk

pytestmark = pytest.mark.slow

Run = Callable[..., Any]

HRCLOG = [sys.executable, "-m", "hrclog"]


@pytest.mark.parametrize("verb", sorted(VERBS))
def test_every_verb_has_help_with_an_example(run: Run, verb: str) -> None:
    result = run(verb, "--help")
    assert result.code == 0
    assert "Example:" in result.out or "Commands:" in result.out


def test_usage_errors_exit_2(run: Run) -> None:
    assert run("analyze").code == 2
    assert run("nonsense").code == 2
    assert run("analyze", "x", "--estimator", "nonsense").code == 2


def test_help_imports_nothing_heavy() -> None:
    code = "import sys; from hrclog.cli import main; main(['--help']); print({m.split('.')[0] for m in sys.modules})"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    modules = out.splitlines()[-1]
    for heavy in ("numpy", "polars", "rerun", "sklearn", "scipy", "pyarrow", "mcap"):
        assert f"'{heavy}'" not in modules


def test_importing_hrclog_imports_nothing_heavy() -> None:
    code = "import sys, hrclog; print(sorted({m.split('.')[0] for m in sys.modules}))"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert "'polars'" not in out
    assert "'numpy'" not in out


def test_every_public_name_is_there() -> None:
    for name in hrclog.__all__:
        assert getattr(hrclog, name) is not None
    with pytest.raises(AttributeError, match="nothing_such"):
        _ = hrclog.nothing_such


def test_info_counts_events_and_executions(run: Run, samples: Path) -> None:
    document = run("info", samples / "single.mcap", samples / "failures.mcap", "--json").json()
    assert [row["finished"] for row in document["files"]] == [True, True]
    assert {row["name"]: row["n_executions"] for row in document["runs"]} == {"paper_0000": 24, "failures_0000": 25}


def test_check_sees_a_damaged_chunk_of_signals(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with hrclog.Recorder(path, agents=["robot"]) as recorder, recorder.task("robot", "pick"):
        for sample in range(2000):
            recorder.signal("distance", sample)
    assert run("check", path).code == 0
    data = bytearray(path.read_bytes())
    chunks = [record for record in Walk(bytes(data), []) if record[0] == Opcode.CHUNK]
    data[chunks[-1][2] + 200] ^= 1
    path.write_bytes(data)
    assert run("check", path).code == 3


def test_check_strict_fails_on_warnings_only_when_asked(run: Run, samples: Path) -> None:
    assert run("check", samples / "campaign").code == 0
    assert run("check", samples / "campaign", "--strict").code == 1
    assert run("check", samples / "single.mcap", "--strict").code == 0
    assert run("check", samples / "killed.mcap.partial").code == 3


def test_recover_closes_a_killed_log_and_says_what_was_lost(run: Run, samples: Path, tmp_path: Path) -> None:
    journal = tmp_path / "killed.mcap.partial"
    journal.write_bytes((samples / "killed.mcap.partial").read_bytes())
    before = run("info", journal, "--json").json()["files"][0]["n_events"]
    assert run("recover", tmp_path).code == 3
    assert not journal.exists()
    closed = tmp_path / "killed.mcap"
    result = run("info", closed, "--json")
    assert result.json()["files"][0] == {
        "path": str(closed),
        "bytes": closed.stat().st_size,
        "n_events": before + 1,  # a remark on what was lost
        "finished": True,
    }
    for again in (result, run("check", closed), run("analyze", closed), run("recover", closed)):
        assert again.code == 3
        assert "killed.mcap.partial" in again.err
        assert "recovered_with_losses" in again.err
    assert run("recover", tmp_path).code == 0


def test_recover_of_no_log_fails(run: Run, tmp_path: Path) -> None:
    (tmp_path / "x.mcap.partial").write_text("nonsense")
    assert run("recover", tmp_path / "x.mcap.partial").code == 1
    assert run("recover", tmp_path / "missing.mcap.partial").code == 1


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_export_writes_all_tables(run: Run, samples: Path, tmp_path: Path, kind: str) -> None:
    result = run("export", samples / "campaign", "-o", tmp_path, "--format", kind, "--json")
    assert result.code == 0
    for row in result.json()["written"]:
        path = Path(row["path"])
        frame = pl.read_csv(path) if kind == "csv" else pl.read_parquet(path)
        assert frame.height == row["rows"]
    assert {path.stem for path in tmp_path.iterdir()} >= {"events", "intervals", "overlaps"}


def test_record_takes_json_lines_and_reports_bad_ones(tmp_path: Path, run: Run) -> None:
    lines = [
        '{"kind": "task_started", "agent": "robot", "task": "pick"}',
        "nonsense",
        '{"kind": "task_ended", "agent": "robot", "task": "place"}',
        '{"kind": "task_ended", "agent": "robot", "task": "pick", "outcome": "failed", "reason": "dropped"}',
    ]
    done = subprocess.run(
        [*HRCLOG, "record", str(tmp_path / "run.mcap"), "--run", "by hand", "--ack"],
        input="\n".join(lines), capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 3
    assert "line 2" in done.stderr
    assert "line 3" in done.stderr
    answers = [json.loads(line) for line in done.stdout.splitlines()]
    assert [answer.get("seq", answer.get("line")) for answer in answers] == [1, 2, 3, 2]
    assert ["error" in answer for answer in answers] == [False, True, True, False]
    runs = run("info", tmp_path / "run.mcap", "--json").json()["runs"]
    assert [(row["name"], row["n_executions"], row["n_failed"]) for row in runs] == [("by hand", 1, 1)]


def test_record_finishes_its_log_when_it_is_asked_to_stop(tmp_path: Path, run: Run) -> None:
    process = subprocess.Popen(
        [*HRCLOG, "record", str(tmp_path / "run.mcap"), "--ack"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write('{"kind": "task_started", "agent": "robot", "task": "pick"}\n')
    process.stdin.flush()
    process.stdout.readline()
    process.terminate()
    assert process.wait(20) == 0
    process.stdin.close()
    process.stdout.close()
    assert run("info", tmp_path / "run.mcap", "--json").json()["runs"][0]["n_open"] == 1


def test_record_refuses_to_overwrite(run: Run, samples: Path, tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes((samples / "single.mcap").read_bytes())
    result = run("record", tmp_path / "run.mcap")
    assert result.code == 1
    assert "not overwriting" in result.err


def piped(path: Path, *lines: str | bytes, options: Sequence[str] = ()) -> subprocess.CompletedProcess[bytes]:
    text = b"\n".join(line if isinstance(line, bytes) else line.encode() for line in lines)
    command = [*HRCLOG, "record", str(path), *options]
    return subprocess.run(command, input=text, capture_output=True, check=False)


def test_runs_of_the_past_begin_and_end_with_their_lines(tmp_path: Path) -> None:
    done = piped(
        tmp_path / "past.mcap",
        '\ufeff{"kind": "run_started", "time_ns": 1700000000000000000, "name": "past", "agents": ["H", "R"]}',
        '{"kind": "task_started", "agent": "H", "task": "pick", "time_ns": 1700000001000000000}',
        '{"kind": "task_started", "agent": "R", "task": "pick", "time_ns": 1700000002000000000}',
        '{"kind": "task_ended", "agent": "R", "task": "pick", "time_ns": 1700000007000000000}',
    )
    assert done.returncode == 0, done.stderr
    analysis = hrclog.analyze(tmp_path / "past.mcap")
    assert analysis.runs.select("name", "makespan_s", "n_open").rows() == [("past", 6.0, 1)]
    assert analysis.runs["agents"].to_list() == [["H", "R"]]


@pytest.mark.parametrize(
    "line",
    [
        '{"kind": "task_started", "agent": "H", "task": "pick", "Outcome": "failed"}',
        '{"kind": "task_started", "agent": "H", "task": "pick", "time_ns": -1}',
        '{"kind": "task_started", "agent": "H", "task": "pick", "time_ns": 1e400}',
        '{"kind": "task_started", "agent": "H", "task": "pick", "role": "aux"}',
        '{"kind": "task_started", "agent": " ", "task": "pick"}',
        '{"kind": "safety_state_changed", "agent": "H", "speed_scale": 50}',
        '{"kind": "run_started", "name": "again"}',
        '{"kind": "nonsense"}',
        b'{"kind": "heartbeat", "agent": "\xff"}',
    ],
)
def test_a_line_that_cannot_be_right_is_refused_and_the_rest_goes_on(line: str | bytes, tmp_path: Path) -> None:
    good = '{"kind": "heartbeat", "agent": "H"}'
    done = piped(tmp_path / "run.mcap", good, line, good, options=["--json"])
    assert done.returncode == 3
    assert b"line 2" in done.stderr
    assert b"Traceback" not in done.stderr
    document = json.loads(done.stdout)
    assert (document["n_events"], document["n_refused"]) == (2, 1)


def test_acknowledgements_are_json_whatever_the_ids_are(tmp_path: Path) -> None:
    line = json.dumps({"kind": "task_started", "agent": "H", "task": "pick", "execution_id": 'a"b'})
    done = piped(tmp_path / "run.mcap", line, options=["--ack"])
    assert json.loads(done.stdout) == {"seq": 1, "execution_id": 'a"b'}


def test_import_reports_gaps(run: Run, data_dir: Path, tmp_path: Path) -> None:
    source = data_dir / "safety_areas" / "task_results_online.json"
    result = run("import", "mongo", source, "-o", tmp_path / "B", "--report-gaps", "--json")
    document = result.json()
    assert (document["n_runs"], document["n_executions"]) == (200, 4800)
    assert sum(gap["n_missing"] for gap in document["gaps"]) == 27
    assert sum(gap["n_attempts"] for gap in document["gaps"]) == 227


def test_import_of_anything_else_is_one_clear_sentence(run: Run, tmp_path: Path, samples: Path) -> None:
    (tmp_path / "x.json").write_text("{not json")
    for source in (tmp_path / "x.json", tmp_path / "missing.json", samples / "single.mcap"):
        result = run("import", "mongo", source, "-o", tmp_path / "out")
        assert result.code == 1
        assert str(source) in result.err


def test_demo_says_where_the_pictures_are(run: Run, tmp_path: Path) -> None:
    result = run("demo", "-o", tmp_path)
    assert result.code == 0
    assert str(tmp_path / "analysis.rrd") in result.out
    assert (tmp_path / "analysis.rrd").exists()


def test_view_without_a_display_is_one_clear_sentence(
    run: Run, samples: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    result = run("view", samples / "single.mcap", "-o", tmp_path)
    assert result.code == 1
    assert "display" in result.err
    assert "Traceback" not in result.err
    assert run("view", tmp_path / "nothing").code == 1


def test_an_rrd_given_to_analyze_is_one_clear_sentence(run: Run, samples: Path, tmp_path: Path) -> None:
    run("analyze", samples / "single.mcap", "-o", tmp_path)
    result = run("analyze", tmp_path / "analysis.rrd", "-o", tmp_path / "out")
    assert result.code == 1
    assert "hrclog view" in result.err


def test_shell_completion_is_offered() -> None:
    environment = os.environ | {"_HRCLOG_COMPLETE": "bash_complete", "COMP_WORDS": "hrclog ana", "COMP_CWORD": "1"}
    code = "import sys; from hrclog.cli import main; sys.exit(main())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, env=environment)
    assert "analyze" in done.stdout


def test_a_finished_log_is_left_alone_by_recover(run: Run, samples: Path, tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    log.write_bytes((samples / "single.mcap").read_bytes())
    result = run("recover", log)
    assert result.code == 0
    assert "closed already" in result.out
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]


def test_a_missing_log_with_a_journal_beside_it_says_how_to_get_it(run: Run, samples: Path, tmp_path: Path) -> None:
    (tmp_path / "run.mcap.partial").write_bytes((samples / "killed.mcap.partial").read_bytes())
    result = run("info", tmp_path / "run.mcap")
    assert result.code == 1
    assert "hrclog recover" in result.err


def test_logs_that_were_not_read_are_named(run: Run, samples: Path) -> None:
    result = run("check", samples / "single.mcap", samples / "failures.mcap", "--json")
    texts = [row["message"] for row in result.json()["diagnostics"] if row["code"] == "unread_logs"]
    assert texts == ["1 unfinished log (*.mcap.partial) beside these was not read"]


def test_a_failure_leaves_no_empty_folder_behind(run: Run, tmp_path: Path) -> None:
    assert run("analyze", tmp_path / "missing.mcap", "-o", tmp_path / "out").code == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("redirect", "code"), [("2>&-", 0), (">/dev/full", 1), (">&-", 0), ("| head -1", 0)], ids=str)
def test_closed_and_full_streams_make_no_traceback(redirect: str, code: int, samples: Path) -> None:
    command = f"'{sys.executable}' -m hrclog info '{samples / 'single.mcap'}' {redirect}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert done.returncode == code
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    "facts", [{"agents": [1]}, {"agents": 5}, {"agents": "human"}, {"software": "x"}, {"name": 5}, {"agnets": ["H"]}]
)
def test_a_first_line_that_says_nonsense_of_the_run_is_refused_and_nothing_written(
    facts: dict[str, Any], tmp_path: Path
) -> None:
    done = piped(tmp_path / "run.mcap", json.dumps({"kind": "run_started", **facts}))
    assert done.returncode == 1
    refused, failed = done.stderr.splitlines()
    assert refused.startswith(b"error: line 1: ")
    assert failed.endswith(b"found 1 line of which none can be recorded, expected events; nothing was written")
    assert list(tmp_path.iterdir()) == []


def test_runs_in_one_pipe_get_a_log_each_in_folders_that_are_made(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "not" / "there" / "cell.mcap"
    lines = [
        '{"kind": "run_started", "name": "first", "time_ns": 1700000000000000000, "details": {"operator": "P07"}}',
        '{"kind": "task_started", "agent": "H", "task": "pick", "time_ns": 1700000001000000000}',
        '{"kind": "run_ended", "time_ns": 1700000009000000000, "outcome": "failed"}',
        '{"kind": "run_started", "name": "second", "time_ns": 1700000010000000000}',
        '{"kind": "signal", "name": "distance", "value": 0.7, "time_ns": 1700000011000000000}',
    ]
    done = piped(path, *lines, options=["--json", "--ack", "--on-run-end", str(tmp_path / "kb.sqlite")])
    assert done.returncode == 0, done.stderr
    further = path.with_name("cell-run2.mcap")
    assert done.stderr.decode().splitlines() == [
        f"{path}: 2 events recorded",
        f"{further}: 0 events, 1 sample recorded",
    ]
    acks, document = done.stdout.decode().split("{\n", 1)
    assert [json.loads(ack) for ack in acks.splitlines()][-1] == {"signals": ["distance"]}
    result = json.loads("{\n" + document)
    assert [run["path"] for run in result["runs"]] == [str(path), str(further)]
    assert (result["n_events"], result["n_samples"], result["path"]) == (2, 1, str(path))
    runs = run("info", path, further, "--json").json()["runs"]
    assert [(row["name"], row["outcome"]) for row in runs] == [("first", "failed"), ("second", "succeeded")]
    learnt = run("kb", "show", "--kb", tmp_path / "kb.sqlite", "--json").json()
    assert sorted(row["name"] for row in learnt["runs"]) == ["first", "second"]


def test_a_log_that_was_cut_off_is_not_called_closed(run: Run, samples: Path, tmp_path: Path) -> None:
    data = (samples / "single.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) * 9 // 10])
    result = run("info", tmp_path / "cut.mcap", "--json")
    assert result.code == 3
    assert result.json()["files"][0]["finished"] is False


def test_recover_with_nothing_to_do_prints_json_only(run: Run, tmp_path: Path) -> None:
    assert run("recover", tmp_path, "--json").json() == {"recovered": [], "failures": []}


def test_export_offers_every_table_that_analyze_writes() -> None:
    assert set(EXPORTED) == set(TABLES)
