"""Tags on the command line: --tag of all that makes logs, --where of all that reads them."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import polars as pl
import pytest

import hrclog
from hrclog.analyzers.projections.schemas import RUNS
from hrclog.cli import VERBS, cli
from hrclog.cli.kb import command as kb

Run = Callable[..., Any]

MAKE_LOGS = ("record", "run", "sim")
READ_LOGS = ("analyze", "annotate", "check", "compare", "export", "info", "report", "score", "view")
COLUMNS = (
    "agent",
    "count",
    "group",
    "label",
    "mean",
    "metric",
    "metrics",
    "n",
    "n_events",
    "name",
    "other",
    "path",
    "plan",
)
KEYS = (
    *COLUMNS,
    "participant",
    "planner",
    "run",
    "run_id",
    "start_s",
    "tag_name",
    "task",
    "value",
    "makespan_s",
    "tags",
    "<b>&",
)


@pytest.fixture
def study(run: Run, tmp_path: Path) -> Path:
    """Return a folder of two conditions of two runs each."""
    for condition, seed in (("slow", 3), ("fast", 4)):
        made = run("sim", "--runs", 2, "--seed", seed, "--tag", f"condition={condition}", "-o", tmp_path / condition)
        assert made.code == 0
    return tmp_path


def option_names(command: click.Command) -> set[str]:
    return {option for parameter in command.params for option in parameter.opts}


def test_every_command_that_makes_logs_or_reads_them_knows_tags() -> None:
    context = click.Context(cli)
    commands = {verb: cli.get_command(context, verb) for verb in VERBS}
    assert {verb for verb, command in commands.items() if command and "--where" in option_names(command)} == set(
        READ_LOGS
    )
    for verb in (*MAKE_LOGS, "annotate"):
        assert "--tag" in option_names(commands[verb] or click.Command("")), verb
    importers = commands["import"]
    assert isinstance(importers, click.Group)
    for name in importers.list_commands(context):
        assert "--tag" in option_names(importers.get_command(context, name) or click.Command("")), name
    assert all("--where" in option_names(kb.commands[name]) for name in ("ingest", "rebuild", "update"))


def test_a_selection_is_what_an_analysis_of_those_logs_alone_is(run: Run, study: Path) -> None:
    folders, once = [study / "slow", study / "fast"], ("--recordings", 1, "--json")
    chosen = run("analyze", *folders, "--where", "condition=fast", *once, "-o", study / "a").json()
    alone = run("analyze", study / "fast", *once, "-o", study / "b").json()
    assert chosen == alone
    assert [one["tags"] for one in chosen["runs"]] == [{"condition": "fast"}] * 2
    tables = [pl.read_parquet(study / name / "runs.parquet") for name in "ab"]
    assert tables[0].equals(tables[1])
    refused = run("analyze", *folders, "--where", "condition=fst", "-o", study / "c")
    assert (refused.code, "condition is fast (2 runs), slow (2 runs)" in refused.err) == (1, True)
    assert run("analyze", *folders, "--where", "condition", "-o", study / "c").code == 2


def test_two_conditions_of_one_folder_are_compared(run: Run, study: Path) -> None:
    logs = study / "all"
    logs.mkdir()
    for condition in ("slow", "fast"):
        for path in (study / condition).glob("*.mcap"):
            path.rename(logs / f"{condition}_{path.name}")
    conditions = ("--where-a", "condition=slow", "--where-b", "condition=fast")
    done = run("compare", logs, *conditions, "--bootstrap", 0, "--estimator", "ols")
    assert done.code == 0
    assert [
        f"{side}: {logs} where condition={name}: 2 runs" in done.out for side, name in (("A", "slow"), ("B", "fast"))
    ] == [True] * 2
    assert run("compare", logs, "--where-a", "condition=slow").code == 2


def test_keys_may_be_any_word_even_those_of_our_columns(run: Run, study: Path) -> None:
    given = [part for key in KEYS for part in ("--tag", f"{key}=<{key}>")]
    assert run("annotate", study / "slow", *given, "--author", "Ada").code == 0
    for command in (
        ("analyze", study / "slow", study / "fast", "-o", study / "out", "--recordings", 1),
        ("report", study / "slow", study / "fast", "-o", study / "report.html", "--runs", 1),
        ("compare", study / "slow", study / "fast", "--bootstrap", 0, "--estimator", "ols"),
        ("info", study / "slow"),
        ("check", study / "slow"),
        ("export", study / "slow", "-o", study / "tables", "--format", "csv"),
    ):
        assert run(*command).code == 0, command
    row = pl.read_csv(study / "tables" / "runs.csv").row(0, named=True)
    assert {f"<{key}>" for key in KEYS} <= {value for column, value in row.items() if column not in RUNS}
    assert (row["name"], row["tag_name"], row["participant"]) == ("paper_0000", "<name>", "<participant>")
    assert "<b>&=" not in (study / "report.html").read_text()


def test_a_campaign_of_other_tags_is_another(run: Run, study: Path) -> None:
    more = ("sim", "--runs", 3, "--seed", 3, "-o", study / "slow")
    assert run(*more, "--tag", "condition=other").code == 1
    assert run(*more, "--tag", "condition=slow").code == 0
    assert hrclog.analyze(study / "slow").runs["condition"].to_list() == ["slow"] * 3


def test_lines_and_options_give_tags_and_the_line_stands_above(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = [
        {"kind": "run_started", "name": "one", "tags": {"trial": 1, "who": "P1"}},
        {"kind": "task_started", "agent": "a", "task": "t"},
        {"kind": "run_started", "name": "two", "tags": ["trial"]},
        {"kind": "run_started", "name": "three"},
        {"kind": "task_started", "agent": "a", "task": "t"},
    ]
    text = "".join(json.dumps(line) + "\n" for line in lines)
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(text.encode())))
    done = run("record", tmp_path / "a.mcap", "--tag", "trial=9", "--tag", "lab=L")
    assert (done.code, "line 3" in done.err, "tags are ['trial']" in done.err) == (3, True, True)
    table = hrclog.analyze(tmp_path).runs.sort("name")
    assert table.select("name", "trial", "who", "lab").rows() == [("one", "1", "P1", "L"), ("three", "9", "", "L")]
