"""The scripts that look for failures by chance work: rounds repeat, findings are kept, a soak is flat."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

pytestmark = pytest.mark.slow


def script(name: str, *arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(ROOT / "benchmarks" / name), *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def test_a_round_of_bytes_finds_nothing(tmp_path: Path) -> None:
    done = script("fuzz.py", "--only", "bytes", "--rounds", "1", "--seed", "5", folder=tmp_path)
    assert (done.returncode, list(tmp_path.iterdir())) == (0, []), done.stdout + done.stderr
    assert "25 files of changed bytes" in done.stdout


def test_a_finding_is_kept_with_the_command_that_repeats_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sitecustomize.py").write_text(  # a reader that fails for files of odd sizes
        "import hrclog.log.reader as reader\n"
        "read = reader.read_logs\n"
        "def fail(paths, **options):\n"
        "    if paths.stat().st_size % 2:\n"
        "        raise ZeroDivisionError(paths.name)\n"
        "    return read(paths, **options)\n"
        "reader.read_logs = fail\n"
    )
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{ROOT}")
    done = script("fuzz.py", "--only", "bytes", "--rounds", "1", "-o", "found", folder=tmp_path)
    assert done.returncode == 1, done.stdout + done.stderr
    text = min((tmp_path / "found").glob("*.txt"))
    command, _, what = text.read_text().partition("\n")
    assert command == "python benchmarks/fuzz.py --only bytes --seed 0 --first 0 --rounds 1"
    assert "ZeroDivisionError" in what
    again = script("fuzz.py", "--file", str(text.with_suffix(".mcap")), folder=tmp_path)
    assert (again.returncode, "ZeroDivisionError" in again.stdout) == (1, True)


def test_a_soak_is_flat(tmp_path: Path) -> None:
    done = script("soak.py", "--hours", "0.1", folder=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert len(done.stdout.splitlines()) == 13
