"""What all importers share: one way to show what an import would do."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
import ros_bags as bags

from hrclog.cli import main
from hrclog.recorders.importers.importer import Foreign, Importer, Option, Remark
from hrclog.recorders.importers.importers import IMPORTERS

ROW = {"recipe": "monday_1", "agent": "robot", "name": "pick", "t_start": 1_780_000_000, "t_end": 1_780_000_004.5}
MAP = '[[action]]\ntopic = "/{agent}/do"\ntask = "work"\n'


def a_dump(folder: Path) -> list[str]:
    (folder / "dump.json").write_text(json.dumps([ROW]))
    return ["mongo", "dump.json"]


def a_table(folder: Path) -> list[str]:
    (folder / "t.csv").write_text("agent,task,start,end\nrobot,pick,1780000000,1780000004\n")
    return ["table", "t.csv"]


def a_bag(folder: Path) -> list[str]:
    status = [bags.status_array(10**18 + n * 10**9, "/robot/do", [("g", 10**18, n)]) for n in (2, 4)]
    bags.write_bag(folder / "bag", status)
    (folder / "cell.toml").write_text(MAP)
    return ["bag", "bag", "--map", "cell.toml"]


@pytest.mark.parametrize("source", [a_dump, a_table, a_bag])
def test_a_dry_run_tells_what_the_import_then_does(
    source: Callable[[Path], list[str]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = ["import", *source(tmp_path), "--json"]
    told = []
    for further in (["--dry-run"], ["--dry-run", "-o", "logs"], ["-o", "logs"]):
        code = main([*arguments, *further])
        told.append((code, json.loads(capsys.readouterr().out)))
        assert Path("logs").exists() is ("--dry-run" not in further)
    assert told[0] == told[1]
    assert told[0][0] == told[2][0]
    assert told[0][1] == told[2][1] | {"written": []}
    assert told[2][1]["written"] != []


@pytest.mark.parametrize(("source", "code"), [(a_dump, 2), (a_table, 0), (a_bag, 2)])
def test_only_what_needs_no_folder_does_without(
    source: Callable[[Path], list[str]], code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["import", *source(tmp_path)]) == code


class Shown(Importer):
    """Shows something, and is never to read."""

    name = "shown"
    options = (Option("show", "Show.", bool, False, only_shows=True),)

    def read(self, sources: Sequence[Path], **options: object) -> Foreign:
        """Fail."""
        raise AssertionError(sources, options)

    def preview(self, sources: Sequence[Path], **options: object) -> Remark | None:
        """Return what is shown."""
        return Remark(f"shown: {sources[0]}") if options["show"] else None


def test_an_option_that_only_shows_writes_nothing_whatever_else_is_given(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(IMPORTERS._loaded, "shown", Shown())
    for further in ([], ["-o", str(tmp_path / "logs")], ["--dry-run"]):
        assert main(["import", "shown", "a", "--show", *further]) == 0
        assert capsys.readouterr().out == "shown: a\n"
    assert main(["import", "shown", "a"]) == 2
    assert list(tmp_path.iterdir()) == []
