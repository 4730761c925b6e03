"""The figures of docs/reliability.md can be made: damaged files are made, read by all readers, and counted."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
SCRIPT = ROOT / "benchmarks" / "reliability.py"
MUTANTS = 25

pytestmark = pytest.mark.slow


def script(*arguments: str, folder: Path) -> str:
    command = [sys.executable, str(SCRIPT), *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_sample_of_damaged_files_is_read_and_counted(tmp_path: Path) -> None:
    arguments = ("--mutants", str(MUTANTS), "--kills", "0", "--seed", "3", "--workers", "1")
    printed = script(*arguments, "-o", "figures.json", folder=tmp_path)
    figures: dict[str, Any] = json.loads((tmp_path / "figures.json").read_text())
    assert sum(row["mutants"] for row in figures["mutants"]) == MUTANTS
    assert not [note for note in figures["notes"] if note.keys() & {"untyped", "costly", "disagrees"}]
    assert "| hrclog | with |" in printed


def test_one_damaged_file_can_be_kept_to_look_at(tmp_path: Path) -> None:
    script("--keep", "4", folder=tmp_path)
    mutant, whole = sorted(tmp_path.iterdir())
    assert [path.name.split(".")[0] for path in (mutant, whole)] == ["mutant-4", "whole"]
    assert mutant.read_bytes() != whole.read_bytes()
