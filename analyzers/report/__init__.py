"""Everything about a set of runs as one HTML file that can be mailed."""

from __future__ import annotations

from hrclog.analyzers.report.save import save_report

__all__ = ["save_report"]
