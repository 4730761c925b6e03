"""Random numbers that stay the same everywhere."""

from __future__ import annotations

import math
import statistics

import pytest

from hrclog.sim.stream import Stream


def test_the_numbers_are_the_same_on_every_python() -> None:
    stream = Stream(1, 2, "agent", "robot")
    assert [stream.uniform(), stream.lognormal(1.0, 0.5), stream.bits(73)] == pytest.approx(EXPECTED, rel=1e-12)


EXPECTED = [0.04719952556950602, 8.030116066835973, 9199963107200229521494]


def test_streams_of_other_seeds_and_purposes_differ() -> None:
    streams = [Stream(1, 0, "a"), Stream(2, 0, "a"), Stream(1, 1, "a"), Stream(1, 0, "b"), Stream(1, 0)]
    assert len({stream.uniform() for stream in streams}) == len(streams)


def test_a_lognormal_has_the_mean_and_deviation_of_its_logarithm() -> None:
    stream = Stream(1, "moments")
    logs = [math.log(stream.lognormal(0.7, 0.3)) for _ in range(20_000)]
    assert statistics.mean(logs) == pytest.approx(0.7, abs=0.01)
    assert statistics.stdev(logs) == pytest.approx(0.3, abs=0.01)


def test_the_smallest_chance_still_gives_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = Stream(1, "edge")
    monkeypatch.setattr(stream.source, "random", lambda: 0.0)
    assert 0.0 < stream.lognormal(0.0, 0.1) < 1.0
