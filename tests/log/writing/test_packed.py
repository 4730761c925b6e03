"""Logs of columns are, to the byte, the logs of the same events one by one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest
from event_strategies import EVENTS
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.errors import LogExistsError
from hrclog.event_rows import to_row
from hrclog.events import COLUMNS, Event
from hrclog.log.messages import message
from hrclog.log.writing.writer import pack_events, packed_bytes, write_log, write_packed

SCHEMA = pl.Schema({name: message.EVENTS[name] for name in COLUMNS})


def frame(events: list[Event]) -> pl.DataFrame:
    return pl.DataFrame([to_row(event) for event in events], schema=SCHEMA)


@settings(max_examples=30)
@given(runs=st.lists(st.lists(EVENTS, min_size=1, max_size=4), min_size=1, max_size=2))
def test_a_part_of_packed_events_is_the_log_of_its_events(
    runs: list[list[Event]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("packed")
    numbered = [
        replace(event, run_id=f"run {number}", seq=seq)
        for number, run in enumerate(runs)
        for seq, event in enumerate(run)
    ]
    packed = pack_events(frame(numbered))
    begin = 0
    for number, run in enumerate(runs):
        end = begin + len(run)
        write_log(folder / f"{number}.mcap", numbered[begin:end])
        write_packed(folder / f"{number} packed.mcap", packed, begin, end)
        expected = (folder / f"{number}.mcap").read_bytes()
        assert (folder / f"{number} packed.mcap").read_bytes() == expected
        assert packed_bytes(packed, begin, end) == expected
        begin = end


def test_a_log_is_never_overwritten(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(b"")
    with pytest.raises(LogExistsError):
        write_packed(tmp_path / "run.mcap", pack_events(frame([])), 0, 0)
