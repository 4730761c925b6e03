"""What logs hold of some of their runs: those that were chosen, those that annotations do not exclude."""

from __future__ import annotations

import polars as pl

from hrclog.log.annotations.exclusions import Exclusion, excluded_runs
from hrclog.log.logs import Logs
from hrclog.log.runs.tags import run_tags
from hrclog.log.runs.where import Condition, Where, conditions, matching_runs


def only_runs(logs: Logs, where: Where) -> Logs:
    """Return what logs hold of some runs; what is known of files without such a run is left out too.

    Args:
        logs: what was read.
        where: which runs, as of `read_logs`.

    Raises:
        HrclogError: no run is so.
    """
    wanted = conditions(where)
    return selected([logs], wanted)[0] if wanted else logs


def selected(parts: list[Logs], wanted: tuple[Condition, ...]) -> list[Logs]:
    """Return of each part what it holds of the runs that meet conditions.

    Raises:
        HrclogError: none does.
    """
    events = pl.concat([part.events.select("run_id", "kind", "seq", "details") for part in parts])
    chosen = set(matching_runs(events["run_id"].unique().sort(), run_tags(events), wanted))
    return [_of_runs(part, chosen) for part in parts]


def without_excluded_runs(parts: list[Logs]) -> tuple[list[Logs], list[Exclusion]]:
    """Leave out runs that annotations exclude, and what is doubtful about their files; return what these say too."""
    # of all parts together: the last word on a run may stand beside any of its files
    exclusions = excluded_runs(part.events for part in parts)
    if not exclusions:
        return parts, []
    runs = {run for part in parts for run in part.events["run_id"].unique()}
    kept = runs - {entry.run_id for entry in exclusions}
    return [_of_runs(part, kept) for part in parts], exclusions


def _of_runs(part: Logs, chosen: set[str]) -> Logs:
    is_chosen = pl.col("run_id").is_in(sorted(chosen))
    events = part.events.filter(is_chosen)
    left_out = set(part.events["path"].unique()) - set(events["path"].unique())
    diagnostics = [
        finding
        for finding in part.diagnostics
        if finding.path not in left_out and (not finding.run_id or finding.run_id in chosen)
    ]
    paths = [path for path in part.paths if str(path) not in left_out]
    return Logs(events, part.signals.filter(is_chosen), diagnostics, paths, part.scene.only(chosen))
