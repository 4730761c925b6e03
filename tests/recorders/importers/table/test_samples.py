"""One session in each format that other tools write, as its makers say it should be read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from hrclog.analyzers.projections.intervals import intervals
from hrclog.log.reader import read_events
from hrclog.recorders.importers.table.importer import TableImporter
from hrclog.recorders.importers.writing import import_files

OPTIONS: dict[str, dict[str, Any]] = {
    "boris/tabular_bench_a.tsv": {"preset": "boris"},
    "boris/tabular_bench_b.csv": {"preset": "boris-tabular"},
    "boris/aggregated.tsv": {"map": "boris"},
    "boris/tabular_v7_bench_a.tsv": {},
    "elan/bench_a_tab.txt": {"preset": "elan"},
    "elan/bench_a_columns.txt": {},
    "plansys2/exported_action_execution_data_collection.csv": {"preset": "plansys2"},
    "lerobot/meta": {},
    "table/samples.csv": {},
    "table/samples.xlsx": {},
    "table/tulip_like_completions.csv": {
        "agent": "=human",
        "outcome": "Canceled",
        "ok": ("false",),
        "canceled": ("true",),
    },
}


@pytest.mark.parametrize("name", OPTIONS)
def test_a_sample_is_read_as_its_makers_say(name: str, data_dir: Path, tmp_path: Path) -> None:
    samples = data_dir.parent / "samples"
    if not samples.is_dir():
        pytest.skip(f"no samples at {samples}")
    expected = json.loads((samples / "expect.json").read_text())["files"][name]["executions"]
    source = samples / name
    source = source if source.is_file() else source / "episodes" / "chunk-000" / "file-000.parquet"
    imported = import_files(TableImporter(), [source], tmp_path, **OPTIONS[name])
    assert all(finding.severity != "error" for finding in imported.diagnostics)
    events = read_events(tmp_path)
    outcomes = dict(events.filter(pl.col("kind") == "task_ended").select("execution_id", "outcome").iter_rows())
    columns = ("agent", "task", "start_ns", "end_ns", "execution_id", "attempt")
    rows = [
        (agent, task, start, end, "open" if end is None else outcomes[execution] or None, attempt)
        for agent, task, start, end, execution, attempt in intervals(events).select(columns).iter_rows()
    ]
    assert sorted(rows) == sorted((*row[2:7], row[7] or 1) for row in expected)
    assert len(imported.runs) == len({row[1] for row in expected})
    assert import_files(TableImporter(), [source], tmp_path, **OPTIONS[name]).written == []
