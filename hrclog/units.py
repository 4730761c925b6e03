"""Units: instants and lengths of time are int64 nanoseconds, statistics are float64 seconds."""

from __future__ import annotations

from typing import Final

NS_PER_S: Final = 1_000_000_000
