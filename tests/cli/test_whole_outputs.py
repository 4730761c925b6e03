"""What commands write is whole or absent: at any death, on a full disk; and half a set is refused."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Callable, Mapping
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import pytest
from dying import contents, die
from full_disks import largest_file
from kb_runs import run_of
from sizes import many

from hrclog.analyzers import drawing
from hrclog.analyzers.analysis import analyze
from hrclog.analyzers.figures.plot import Plot
from hrclog.analyzers.report import document
from hrclog.analyzers.result import Analysis
from hrclog.cli import main
from hrclog.files import write_output
from hrclog.log.writing.writer import write_log

pytestmark = pytest.mark.skipif(os.name != "posix", reason="limits the size of files as POSIX does")

Run = Callable[..., Any]
SAMPLES = Path(__file__).parents[2] / "sample_logs"
LOGS = {"old": SAMPLES / "single.mcap", "new": SAMPLES / "failures.mcap"}

COMMANDS: Mapping[str, str] = {
    "csv": "export LOG -o OUT",
    "parquet": "export LOG -o OUT --format parquet",
    "report": "report LOG -o OUT/r.html --pdf OUT/f.pdf --png OUT/png --svg OUT/svg",
    "compare": f"compare LOG {SAMPLES / 'cell_ssm.mcap'} -o OUT --bootstrap 0",
    "plans": "plan paper --random 2 -o OUT",
    "kb json": "kb export --kb KB -o OUT",
    "kb parquet": "kb export --kb KB -o OUT --format parquet",
}
"""Each writes into OUT, and with another LOG or KB other files."""

ONCE = ("plans",)
"""What replaces no file."""


@pytest.fixture(scope="module")
def analyses() -> dict[str, Analysis]:
    return {str(log): analyze(log) for log in (*LOGS.values(), SAMPLES / "cell_ssm.mcap")}


@pytest.fixture(scope="module")
def bases(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the knowledge bases old.sqlite and new.sqlite."""
    folder = tmp_path_factory.mktemp("bases")
    for number, name in enumerate(("old", "new")):
        write_log(folder / f"{name}.mcap", run_of(number))
        main(["kb", "update", str(folder / f"{name}.mcap"), "--kb", str(folder / f"{name}.sqlite")])
    return folder


@pytest.fixture
def quick(analyses: dict[str, Analysis], monkeypatch: pytest.MonkeyPatch) -> None:
    """Analyse a log once, and write pictures without drawing them."""
    reports = {str(log): document.report(analyses[str(log)], runs=1) for log in LOGS.values()}

    def of(logs: object) -> str:
        return str(logs if isinstance(logs, str | Path) else next(iter(logs)))  # type: ignore[call-overload] - several

    def draw(plot: Plot, path: Path) -> None:
        write_output(path, plot.title.encode() * 20)

    monkeypatch.setattr("hrclog.analyzers.analysis.analyze", lambda logs, *_, **__: analyses[of(logs)])
    monkeypatch.setattr(document, "report", lambda analysis, **_: reports[str(analysis.runs["path"][0])])
    monkeypatch.setattr(drawing, "svg", lambda plot: f"<svg><title>{len(plot.title)}</title></svg>")
    monkeypatch.setattr(drawing, "save_png", draw)
    monkeypatch.setattr(drawing, "save_svg", draw)
    monkeypatch.setattr(drawing, "save_pdf", lambda plots, path: write_output(path, plots[-1].title.encode() * 900))


def do(command: str, which: str, out: Path, bases: Path) -> int:
    """Let a command make the old or the new files, and return its exit code."""
    places = {"LOG": LOGS[which], "OUT": out, "KB": bases / f"{which}.sqlite"}
    text = COMMANDS[command]
    for name, place in places.items():
        text = text.replace(name, str(place))
    return main(text.split())


def groups(files: Mapping[str, bytes]) -> dict[str, dict[str, bytes]]:
    """Return files by what belongs together: those of a folder, or a single one that is named itself."""
    by_place: dict[str, dict[str, bytes]] = {}
    for name, content in files.items():
        place = name if name in ("r.html", "f.pdf") else str(Path(name).parent)
        by_place.setdefault(place, {})[name] = content
    return by_place


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("command", [name for name in COMMANDS if name != "compare"])
def test_files_are_old_or_new_or_marked_whenever_a_command_dies(command: str, bases: Path, tmp_path: Path) -> None:
    if command not in ONCE:
        assert do(command, "old", tmp_path / "old", bases) == 0
    assert do(command, "new", tmp_path / "new", bases) == 0
    old, new = contents(tmp_path / "old"), contents(tmp_path / "new")
    n_changes = die(lambda: do(command, "new", tmp_path / "counted", bases), None)
    for after in range(0, n_changes, many(1 + n_changes // 9, fuzz=1)):
        out = tmp_path / str(after)
        if command not in ONCE:
            do(command, "old", out, bases)
        die(lambda to=out: do(command, "new", to, bases), after)  # type: ignore[misc] - bound at once
        there = contents(out)
        markers = {name: there.pop(name) for name in list(there) if name.endswith(".unfinished")}
        marked = {str(Path(name).parent) for name, text in markers.items() if text}
        for place in (groups(old) | groups(new)).keys() - marked:
            assert groups(there).get(place, {}) in (groups(old).get(place, {}), groups(new).get(place, {}))
        is_refused = command in ONCE and there == new and not marked
        assert do(command, "new", out, bases) == is_refused
        assert contents(out) == new
        assert is_refused or list(out.rglob(".hrclog-*")) == []


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("command", COMMANDS)
def test_a_full_disk_leaves_the_old_files(command: str, bases: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    if command not in ONCE:
        assert do(command, "old", out, bases) == 0
    before = contents(out)
    do(command, "new", tmp_path / "new", bases)
    sizes = sorted(len(text) for text in contents(tmp_path / "new").values())
    for size in {sizes[0] - 1, sizes[len(sizes) // 2] - 1, sizes[-1] - 1}:
        with redirect_stderr(io.StringIO()) as told, redirect_stdout(io.StringIO()), largest_file(size):
            assert do(command, "new", out, bases) == 1
        assert re.fullmatch(
            r"hrclog: error: \S+: cannot be written \(File too large\); free space .*\n", told.getvalue()
        )
        assert contents(out) == before
        assert list(out.rglob(".hrclog-*")) == []


@pytest.mark.parametrize("command", ["view RESULTS --web", "report RESULTS -o r.html", "compare RESULTS LOG"])
def test_half_a_set_of_results_is_refused(
    command: str, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    results = tmp_path / "results"
    results.mkdir()
    (results / "analysis.rrd").write_bytes(b"")
    (results / "analysis.unfinished").write_text('{"files": {}}')
    result = run(*command.replace("RESULTS", "results").replace("LOG", str(LOGS["old"])).split())
    assert result.code == 1
    assert "results that are being replaced, or whose writing was broken off (analysis.unfinished)" in result.err
    assert "run hrclog analyze LOG... -o results again" in result.err
    assert list(tmp_path.iterdir()) == [results]


def test_half_an_export_of_a_knowledge_base_is_not_taken_in(run: Run, bases: Path, tmp_path: Path) -> None:
    run("kb", "export", "--kb", bases / "old.sqlite", "-o", tmp_path / "out")
    (tmp_path / "out" / "kb-json.unfinished").write_text("{}")
    result = run("kb", "import", tmp_path / "out", "--kb", tmp_path / "new.sqlite")
    assert result.code == 1
    assert "broken off (kb-json.unfinished)" in result.err


@pytest.mark.parametrize("size", range(0, 100_000, many(25_000, fuzz=2_000)))
def test_a_full_disk_is_one_error_of_a_knowledge_base_which_then_goes_on(size: int, run: Run, tmp_path: Path) -> None:
    for number in range(3):
        write_log(tmp_path / f"{number}.mcap", run_of(number))
    ingest = ["kb", "ingest", str(tmp_path), "--kb", str(tmp_path / "kb.sqlite")]
    with redirect_stderr(io.StringIO()) as told, redirect_stdout(io.StringIO()), largest_file(size):
        assert main(ingest) == 1
    assert re.fullmatch(r"hrclog: error: \S+: it cannot be written or read .*; make room .*\n", told.getvalue())
    ingested = run(*ingest, "--json").json()
    assert sorted(ingested["added"] + ingested["unchanged"]) == [f"run-{number:04d}" for number in range(3)]


def test_view_writes_the_recordings_of_a_log_as_one_set(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("to_rerun", "run_to_rerun"):  # drawing takes long
        monkeypatch.setattr(Analysis, name, lambda *arguments: write_output(arguments[-1], b"drawn"))
    opened: list[Path] = []
    monkeypatch.setattr("hrclog.analyzers.rerun.viewer.open_viewer", lambda paths, _: opened.extend(paths) or 0)
    monkeypatch.setattr("hrclog.analyzers.rerun.viewer.check_viewer", lambda *_: None)
    assert run("view", LOGS["old"], "-o", tmp_path).code == 0
    assert opened
    assert all(path.is_file() for path in opened)
    assert run("analyze", LOGS["new"], "-o", tmp_path).code == 0
    assert [path.exists() for path in opened] == [path.name == "analysis.rrd" for path in opened]
