"""CPU time and peak memory of a function, the best of a few runs."""

from __future__ import annotations

import os
import resource
from collections.abc import Callable
from typing import Any


def cpu_seconds(function: Callable[[], Any], repeats: int = 3) -> float:
    """Return the least CPU time of a call, user and system, over all threads."""
    best = float("inf")
    for _ in range(repeats):
        before = os.times()
        function()
        after = os.times()
        best = min(best, after.user + after.system - before.user - before.system)
    return best


def child_cpu_seconds(function: Callable[[], Any], repeats: int = 3) -> float:
    """Return the least CPU time of the processes that a call starts."""
    best = float("inf")
    for _ in range(repeats):
        before = os.times()
        function()
        after = os.times()
        user, system = after.children_user - before.children_user, after.children_system - before.children_system
        best = min(best, user + system)
    return best


def peak_mebibytes() -> float:
    """Return the process's largest resident size so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def table(rows: list[tuple[str, float]], what: str, amount: float) -> str:
    """Return a markdown table of CPU time, rate and ratio to the first row."""
    lines = [f"| {what} | CPU s | per CPU s | ratio |", "| --- | --- | --- | --- |"]
    first = rows[0][1]
    lines += [f"| {name} | {cost:.3f} | {amount / cost:,.0f} | {cost / first:.1f} |" for name, cost in rows]
    return "\n".join(lines)
