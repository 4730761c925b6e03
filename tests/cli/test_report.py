"""`hrclog report`: one file, the figures beside it, and bad input in a sentence."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hrclog.events import RunEnded, RunStarted
from hrclog.log.writing.writer import write_log

Run = Callable[..., Any]


@pytest.mark.slow
def test_the_report_is_one_file_and_its_figures_can_be_had_in_three_formats(
    run: Run, samples: Path, tmp_path: Path
) -> None:
    out = tmp_path / "deep" / "report.html"
    pictures = ("--pdf", tmp_path / "figures.pdf", "--png", tmp_path / "png", "--svg", tmp_path / "svg")
    result = run("report", samples / "three_agents.mcap", "-o", out, *pictures, "--title", "Three of us", "--json")
    assert result.code == 0, result.err
    document = result.json()
    page = out.read_text(encoding="utf-8")
    assert "<title>Three of us</title>" in page
    assert "--title &#39;Three of us&#39;" in page
    assert str(out) not in page
    assert document["title"] == "Three of us"
    assert document["runs"] == [
        {"run_id": document["runs"][0]["run_id"], "name": "three-agents_0000", "why": "the only one with executions"}
    ]
    assert document["findings"]
    count = len(document["figures"])
    assert page.count("<figure ") == count
    for kind in ("png", "svg"):
        files = sorted((tmp_path / kind).glob(f"*.{kind}"))
        assert sorted(document["written"][kind]) == [str(path) for path in files]
        assert len(files) == count
    assert (tmp_path / "figures.pdf").read_bytes().startswith(b"%PDF")
    assert len(re.findall(rb"/Type /Page\b", (tmp_path / "figures.pdf").read_bytes())) == count


def test_the_same_logs_give_the_same_bytes_wherever_the_report_lies(run: Run, samples: Path, tmp_path: Path) -> None:
    for name in ("a.html", "b.html"):
        result = run("report", samples / "single.mcap", samples / "failures.mcap", "-o", tmp_path / name, "--runs", "1")
        assert result.code == 0
        assert result.out.splitlines()[0] == "2 runs of 2 agents (human, robot) on 2025-01-01 (UTC), 49 executions."
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "1 of 2 runs is shown" in page
    assert "failures_0000</h3>" in page
    assert "--runs 1" in page


def test_one_bad_file_never_hides_the_others_and_the_report_says_so(run: Run, samples: Path, tmp_path: Path) -> None:
    (tmp_path / "text.mcap").write_text("not a log")
    result = run("report", samples / "single.mcap", tmp_path / "text.mcap", "-o", tmp_path / "report.html")
    assert result.code == 3
    assert "text.mcap" in result.err
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Data was lost or skipped (1 error, see Diagnostics)." in page
    assert "unreadable_file" in page


def fails(result: Any, *parts: str) -> None:  # noqa: ANN401 - what the command did
    """Check that a command failed with one sentence that holds some texts."""
    assert result.code == 1
    assert result.out == ""
    assert len(result.err.splitlines()) == 1, result.err
    for part in parts:
        assert part in result.err


def test_what_is_no_log_fails_with_one_sentence(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "out" / "report.html"
    (tmp_path / "a.rrd").write_bytes(b"RRF2\x00\x00")
    fails(run("report", tmp_path / "a.rrd", "-o", out), "a.rrd", "Rerun recording", "hrclog view")
    for argument in (tmp_path / "missing.mcap", f"{tmp_path}/*.mcap"):
        fails(run("report", argument, "-o", out), str(tmp_path))
    write_log(
        tmp_path / "idle.mcap", [RunStarted(time_ns=10**18, run_id="r"), RunEnded(time_ns=10**18 + 1, run_id="r")]
    )
    fails(run("report", tmp_path / "idle.mcap", "-o", out), "no agent did anything in 1 run", "hrclog info")
    assert not out.parent.exists()


@pytest.mark.parametrize("option", ["-o", "--pdf", "--png", "--svg"])
def test_a_place_that_cannot_be_written_is_said_before_the_work(
    option: str, run: Run, samples: Path, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    name = {"-o": "report.html", "--pdf": "figures.pdf"}.get(option, "figures")
    places = ["-o", tmp_path / "report.html", option, tmp_path / "file" / name]
    fails(run("report", samples / "single.mcap", *places), str(tmp_path / "file"), "choose another folder")
    assert not (tmp_path / "report.html").exists()


def test_a_slip_of_the_hand_overwrites_no_log(run: Run, samples: Path, tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    log.write_bytes((samples / "single.mcap").read_bytes())
    for option in ("-o", "--pdf"):
        result = run("report", log, option, log)
        assert result.code == 2
        assert "expected one that ends in ." in result.err
    assert log.read_bytes() == (samples / "single.mcap").read_bytes()


def linked(kind: str, log: Path, folder: Path) -> Path:
    """Return what is to be written over a log, as a link to it."""
    folder.mkdir()
    link = folder / f"figure.{kind}"
    link.symlink_to(log)
    return link if kind in ("html", "pdf") else folder


@pytest.mark.parametrize(("option", "kind"), [("-o", "html"), ("--pdf", "pdf"), ("--png", "png"), ("--svg", "svg")])
def test_no_output_is_written_over_a_log_through_a_link_neither(
    option: str, kind: str, run: Run, samples: Path, tmp_path: Path
) -> None:
    content = (samples / "single.mcap").read_bytes()
    log = tmp_path / "run.mcap"
    log.write_bytes(content)
    target = linked(kind, log, tmp_path / "links")
    places = [option, target] if option == "-o" else ["-o", tmp_path / "report.html", option, target]
    fails(run("report", tmp_path, *places), "is one of the logs to read, so nothing was written", f"figure.{kind}")
    assert log.read_bytes() == content
    assert not (tmp_path / "report.html").exists()
    named = tmp_path / "log.html"
    named.write_bytes(content)
    fails(run("report", named, "-o", named), "log.html: is one of the logs")
    assert named.read_bytes() == content


@pytest.mark.slow
def test_the_order_of_the_logs_changes_nothing(run: Run, samples: Path, tmp_path: Path) -> None:
    logs = [samples / "single.mcap", samples / "failures.mcap"]
    for name, given in (("a", logs), ("b", logs[::-1])):
        assert run("report", *given, "-o", tmp_path / f"{name}.html", "--runs", "0").code == 0
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()
    assert run("report", *logs * 3, "-o", tmp_path / "c.html", "--runs", "0").code == 0
    assert "hrclog report &lt;6 logs&gt; --runs 0" in (tmp_path / "c.html").read_text(encoding="utf-8")
