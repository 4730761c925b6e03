"""What is built is what is meant to be shipped, and it works on its own."""

from __future__ import annotations

import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the sdist, and the wheel that was built from it."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_the_wheel_holds_hrclog_with_all_rooms_and_nothing_else(built: Path) -> None:
    [wheel] = built.glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    tops = {name.split("/")[0] for name in names}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"hrclog"}
    for room in ("analyzers", "recorders", "sim", "log", "cli", "sample_logs"):
        assert f"hrclog/{room}/__init__.py" in names
    modules = {
        str(Path("hrclog", *path.relative_to(ROOT).parts[room == "hrclog" :]))
        for room in ("hrclog", "analyzers", "recorders", "sim")
        for path in (ROOT / room).rglob("*.py")
    }
    assert modules <= set(names), modules - set(names)
    for data in ("hrclog/py.typed", "hrclog/log/messages/TaskEvent.msg", "hrclog/sim/scenarios/paper.json"):
        assert data in names
    assert any(name.startswith("hrclog/sample_logs/campaign/") for name in names)


def test_the_sdist_holds_what_a_wheel_is_built_from(built: Path) -> None:
    [sdist] = built.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        names = {name.split("/", 1)[1] for name in archive.getnames() if "/" in name}
    pages = {"README.md", "CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "LICENSE"}
    assert {*pages, "pyproject.toml", "analyzers/projections/intervals.py", "recorders/recorder.py"} <= names


def test_the_wheel_runs_the_demo_on_its_own(built: Path, tmp_path: Path) -> None:
    [wheel] = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "site")  # noqa: S202 - our own wheel
    code = "import sys; sys.path.insert(0, sys.argv.pop(1)); import hrclog; print(hrclog.__file__); "
    code += "from hrclog.cli import main; sys.exit(main(['demo', '-o', 'out']))"
    command = [sys.executable, "-c", code, str(tmp_path / "site")]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(str(tmp_path / "site"))
    assert (tmp_path / "out" / "analysis.rrd").exists()
