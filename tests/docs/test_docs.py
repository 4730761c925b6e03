"""Every command and example in the README and in docs/ is run, and the pages name everything there is."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from warm import warm_hrclog

from hrclog.analyzers.projections import schemas
from hrclog.analyzers.search.methods import METHODS
from hrclog.analyzers.synergy.estimators import ESTIMATORS, YARDSTICKS
from hrclog.cli import VERBS
from hrclog.diagnostic import CODES
from hrclog.events import COLUMNS, EVENT_CLASSES
from hrclog.explanations import EXPLANATIONS
from hrclog.planning.dispatch_mode import MODES
from hrclog.sim.cell.safety_settings import POLICIES

ROOT = Path(__file__).parents[2]
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "sample_logs" / "README.md",
    *sorted((ROOT / "docs").glob("*.md")),
]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
NEEDS_BULLET = re.compile(r"engine[ =]\"?bullet")
FEWER = {
    # the README does so with the whole campaign
    "commands.md": (("analyze sample_logs/campaign", "analyze sample_logs/failures.mcap"),),
    "README.md": (("analyze study -o study_results", "analyze study -o study_results --recordings 1"),),
    "paper-figures.md": (
        ("--runs 50 --seed 1", "--runs 6 --seed 1"),
        ("50 runs of 2 agents (human, robot) between", "6 runs of 2 agents (human, robot)..."),
        ("2025-01-01 and 2025-01-02 (UTC), 1,200 executions.", "(UTC), 144 executions."),
    ),
}
"""What takes minutes as it is shown, and what is tried of it; all of it where HRCLOG_FUZZ is set."""
EXITS = re.compile(r"\s+# exits (\d+).*$")


@dataclass(frozen=True)
class Step:
    """A command of a page, and the output that the page shows."""

    command: str
    code: int
    output: list[str]


def blocks(page: Path) -> list[tuple[str, str]]:
    text = page.read_text(encoding="utf-8")
    for shown, tried in (
        () if os.environ.get("HRCLOG_FUZZ") else FEWER.get(page.name if page.parent != ROOT / "sample_logs" else "", ())
    ):
        assert shown in text, f"{page.name}: {shown}"
        text = text.replace(shown, tried)
    return FENCE.findall(text)


def steps(block: str) -> list[Step]:
    found: list[Step] = []
    for line in block.splitlines():
        if line.startswith("$ "):
            exits = EXITS.search(line)
            found.append(Step(EXITS.sub("", line[2:]), int(exits[1]) if exits else 0, []))
        elif line.startswith("> ") and found and not found[-1].output:  # the command goes on
            found[-1] = replace(found[-1], command=f"{found[-1].command}\n{line[2:]}")
        elif found:
            found[-1].output.append(line)
    return found


def matches(shown: list[str], printed: list[str]) -> bool:
    """Return whether the printed lines are as shown; `...` stands for any number of lines."""
    text = "\n".join(line.rstrip() for line in shown).strip()
    pattern = re.escape(text).replace(r"\.\.\.", ".*?")
    return re.fullmatch(pattern, "\n".join(line.rstrip() for line in printed).strip(), re.DOTALL) is not None


@pytest.fixture
def workplace(tmp_path: Path) -> Path:
    """Return a folder with the sample logs, as somebody who reads the page would have it."""
    shutil.copytree(ROOT / "sample_logs", tmp_path / "sample_logs")
    return tmp_path


@pytest.fixture(scope="module")
def programs() -> Iterator[str]:
    """Return the value of PATH; but for HRCLOG_FUZZ, `hrclog` is there without the time that its imports take."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    if os.environ.get("HRCLOG_FUZZ"):
        yield path
        return
    with warm_hrclog() as folder:
        yield f"{folder}{os.pathsep}{path}"


def execute(command: list[str], folder: Path, programs: str) -> subprocess.CompletedProcess[str]:
    streams = {"capture_output": True, "text": True, "stdin": subprocess.DEVNULL}
    environment = os.environ | {"PATH": programs, "COLUMNS": "110"}
    return subprocess.run(command, cwd=folder, env=environment, check=False, **streams)


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_console_example_runs_and_prints_what_the_page_shows(page: Path, workplace: Path, programs: str) -> None:
    folder = workplace / "sample_logs" if page.parent.name == "sample_logs" else workplace
    left_out = 0
    for language, block in blocks(page):
        if NEEDS_BULLET.search(block) and not find_spec("pybullet"):
            left_out += language in ("console", "python")
            continue
        if language == "console":
            for step in steps(block):
                done = execute(["bash", "-c", step.command], folder, programs)
                assert done.returncode == step.code, f"{page.name}: {step.command}\n{done.stdout}{done.stderr}"
                if any(line.strip() for line in step.output):
                    assert matches(step.output, done.stdout.splitlines()), f"{step.command}\n{done.stdout}"
        elif language == "python":
            (folder / "example.py").write_text(block, encoding="utf-8")
            done = execute([sys.executable, "-W", "error", "example.py"], folder, programs)
            assert done.returncode == 0, f"{page.name}:\n{block}\n{done.stderr}"
    if left_out:
        pytest.skip(f"{left_out} examples need PyBullet, which is not installed; the others ran")


def test_the_two_commands_of_the_readme_are_what_ci_runs() -> None:
    readme, ci = (ROOT / "README.md").read_text(), (ROOT / ".ci" / "run").read_text()
    setup = "python3 -m venv .venv && .venv/bin/pip install -e '.[all]' && .venv/bin/hrclog demo"
    tests = "python3 -m venv .venv && .venv/bin/pip install -e '.[all,test]' && .venv/bin/pytest"
    assert setup in readme
    assert tests in readme
    assert setup.replace("install -e", "install -q -e") in ci
    assert "install -q -e '.[all,test]'" in ci


def test_pages_name_every_event_column_and_table_column() -> None:
    events = (ROOT / "docs" / "events.md").read_text()
    for name in (*EVENT_CLASSES, *COLUMNS):
        assert name == "kind" or f"`{name}`" in events, name
    tables = (ROOT / "docs" / "tables.md").read_text()
    for schema in (
        "INTERVALS",
        "EXECUTIONS",
        "OVERLAPS",
        "PAIR_OVERLAPS",
        "DURATIONS",
        "SYNERGIES",
        "RUNS",
        "METRICS",
        "SIGNALS",
    ):
        for name in getattr(schemas, schema):
            assert f"| `{name}` |" in tables, name


def test_pages_name_every_diagnostic_and_every_verb() -> None:
    diagnostics = (ROOT / "docs" / "diagnostics.md").read_text()
    for code, (severity, meaning) in CODES.items():
        assert f"| `{code}` | {severity} | {meaning} |" in diagnostics
        assert f"| `{code}` | {EXPLANATIONS[code].cause} | {EXPLANATIONS[code].remedy} |" in diagnostics
    commands = (ROOT / "docs" / "commands.md").read_text()
    for verb in VERBS:
        assert f"## hrclog {verb}" in commands


def test_the_page_of_estimators_lists_those_that_there_are() -> None:
    page = (ROOT / "docs" / "estimators.md").read_text(encoding="utf-8")
    for estimator in (*ESTIMATORS.values(), *YARDSTICKS.values()):
        assert f"| `{estimator.name}` | {estimator.summary}" in page


@pytest.mark.parametrize(
    ("page", "table"), [("dispatching.md", MODES), ("planning.md", METHODS), ("simulation.md", POLICIES)]
)
def test_a_page_lists_the_things_that_there_are(page: str, table: dict[str, Any]) -> None:
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    for name, record in table.items():
        assert f"| `{name}` | {record.summary}" in text


def test_links_between_pages_lead_somewhere() -> None:
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text(encoding="utf-8")):
            if "://" not in target:
                assert (page.parent / target).exists(), f"{page.name}: {target}"
