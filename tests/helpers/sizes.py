"""How many examples a test takes: few in every run, many when somebody looks for rare faults (`make fuzz`)."""

from __future__ import annotations

import os


def many(usual: int, *, fuzz: int) -> int:
    """Return the usual size, or the large one where the variable HRCLOG_FUZZ is set."""
    return fuzz if os.environ.get("HRCLOG_FUZZ") else usual
