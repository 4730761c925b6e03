"""Arrows between the rooms go one way, and every diagnostic that is documented can be met."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from hrclog.diagnostic import CODES

ROOT = Path(__file__).parents[1]
ROOMS = ("recorders", "analyzers", "sim")
ALLOWED = {"hrclog": set(), "recorders": set(), "analyzers": set(), "sim": {"recorders"}}
FREE = {"hrclog/__init__.py", "hrclog/cli"}


def imported(path: Path) -> set[str]:
    """Return the rooms that a module imports, wherever in it."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    names = [alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names]
    names += [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    return {room for room in ROOMS for name in names if name.startswith(f"hrclog.{room}")}


@pytest.mark.parametrize("room", sorted(ALLOWED))
def test_a_room_imports_only_what_it_may(room: str) -> None:
    for path in (ROOT / room).rglob("*.py"):
        name = str(path.relative_to(ROOT))
        if path.resolve() != ROOT.resolve() / name or any(name.startswith(free) for free in FREE):
            continue
        assert imported(path) <= ALLOWED[room] | {room}, name


def test_every_diagnostic_code_is_used_somewhere() -> None:
    sources = [
        path.read_text(encoding="utf-8")
        for room in ("hrclog", *ROOMS)
        for path in (ROOT / room).rglob("*.py")
        if path.name != "diagnostic.py"
    ]
    assert [code for code in CODES if not any(f'"{code}"' in source for source in sources)] == []
