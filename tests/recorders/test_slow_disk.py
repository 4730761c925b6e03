"""Many threads and a slow disk: events wait for one write at most, and whoever records can see it."""

from __future__ import annotations

import statistics
import threading
import time
from pathlib import Path

import pytest

from hrclog.log.reader import read_logs
from hrclog.log.writing.journal import Journal
from hrclog.recorders.recorder import Recorder
from hrclog.recorders.turns import Turns

WRITE_S = 0.05
N_SAMPLERS = 4
PATIENCE_S = 10.0


def slow_down(monkeypatch: pytest.MonkeyPatch) -> None:
    write = Journal._write_all

    def write_slowly(journal: Journal, data: bytes) -> None:
        time.sleep(WRITE_S)
        write(journal, data)

    monkeypatch.setattr(Journal, "_write_all", write_slowly)


def test_events_wait_for_one_write_on_a_slow_disk_however_many_threads_sample(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder, over = Recorder(tmp_path / "run.mcap"), threading.Event()
    assert recorder.pressure().longest_write_s > 0.0
    slow_down(monkeypatch)

    def sample(name: str) -> None:
        while not over.is_set():
            recorder.signal(name, 1.0)

    samplers = [threading.Thread(target=sample, args=(f"signal {i}",)) for i in range(N_SAMPLERS)]
    for thread in samplers:
        thread.start()
    took_s, waiting = [], []
    for _ in range(6):
        began = time.monotonic()
        recorder.start("robot", "pick").end()
        took_s.append((time.monotonic() - began) / 2)
        waiting.append(recorder.pressure().waiting)
    over.set()
    for thread in samplers:
        thread.join()
    monkeypatch.undo()
    recorder.close()
    assert statistics.median(took_s) < 2.5 * WRITE_S
    assert max(waiting) >= N_SAMPLERS - 1
    assert recorder.pressure().longest_write_s >= WRITE_S
    logs = read_logs([tmp_path / "run.mcap"], signals=True)
    assert not [finding for finding in logs.diagnostics if finding.severity == "error"]
    assert logs.events.height == 2 + 2 * 6
    assert logs.signals.height >= 6


def in_turn(turns: Turns, kinds: str) -> str:
    """Return in which order threads have their turns that ask for them in that of `kinds`, while the first has its own.

    `e` is an event, `s` a sample.
    """
    order: list[str] = []
    lock, held = threading.Lock(), threading.Event()

    def ask(number: int, kind: str) -> None:
        with turns.events if kind == "e" else turns.samples, lock:
            order.append(f"{kind}{number}")
            if number == 0:
                held.wait(PATIENCE_S)

    threads = [threading.Thread(target=ask, args=pair) for pair in enumerate(kinds)]
    for number, thread in enumerate(threads):
        thread.start()
        until(turns, number, order)
    held.set()
    for thread in threads:
        thread.join()
    assert turns.waiting == 0
    return " ".join(order)


def until(turns: Turns, n_waiting: int, order: list[str]) -> None:
    """Wait until so many threads wait behind the first, which has its turn."""
    deadline = time.monotonic() + PATIENCE_S
    while (turns.waiting != n_waiting or not order) and time.monotonic() < deadline:
        time.sleep(0.001)


def test_who_asks_first_is_first_and_events_go_before_samples() -> None:
    assert in_turn(Turns(), "ssese") == "s0 e2 e4 s1 s3"
    assert in_turn(Turns(), "eseses") == "e0 e2 e4 s1 s3 s5"


def test_a_thread_in_its_turn_has_it_again_at_once() -> None:
    turns = Turns()
    with turns.events, turns.samples, turns.events:
        assert turns.waiting == 0
    assert in_turn(turns, "es") == "e0 s1"


def test_an_interrupt_while_waiting_gives_the_place_back(monkeypatch: pytest.MonkeyPatch) -> None:
    turns = Turns()

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    entered, leave = threading.Event(), threading.Event()

    def hold() -> None:
        with turns.events:
            entered.set()
            leave.wait(PATIENCE_S)

    holder = threading.Thread(target=hold)
    holder.start()
    entered.wait(PATIENCE_S)
    other = threading.Thread(target=turns.samples.__enter__)  # never leaves
    monkeypatch.setattr("hrclog.recorders.turns.Turn._is_next", interrupted)
    with pytest.raises(KeyboardInterrupt), turns.samples:
        pass
    monkeypatch.undo()
    leave.set()
    holder.join()
    assert turns.waiting == 0
    other.start()
    other.join()
    monkeypatch.setattr("hrclog.recorders.turns._LONGEST_WAIT_S", 0.05)
    began = time.monotonic()
    with turns.events:  # a thread that died in its turn holds up nobody for ever
        assert time.monotonic() - began < PATIENCE_S / 2
