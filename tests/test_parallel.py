"""The same function over many items, in this process and in several."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from parallel_work import doubled, noted, process, refused

from hrclog.errors import HrclogError
from hrclog.parallel import ordered_map

pytestmark = pytest.mark.slow  # each test starts processes


@pytest.mark.parametrize("workers", [1, 2, 9])
def test_results_come_in_the_order_of_the_items(workers: int) -> None:
    assert list(ordered_map(doubled, range(7), workers)) == [2 * number for number in range(7)]


def test_one_worker_is_this_process_and_waits_to_be_asked() -> None:
    asked: list[int] = []
    results = ordered_map(asked.append, [1, 2, 3])  # a bound method of a local list cannot be sent anywhere
    assert asked == []
    next(results)
    assert asked == [1]
    assert list(ordered_map(process, [5])) == [(5, os.getpid())]


def test_a_single_item_needs_no_other_process() -> None:
    assert list(ordered_map(process, [5], 4)) == [(5, os.getpid())]
    assert list(ordered_map(process, [], 4)) == []


def test_several_workers_are_other_processes() -> None:
    found = list(ordered_map(process, range(6), 2))
    assert [number for number, _ in found] == list(range(6))
    assert os.getpid() not in {pid for _, pid in found}
    assert len({pid for _, pid in found}) <= 2


@pytest.mark.parametrize("workers", [1, 2])
def test_an_exception_comes_through_after_the_results_before_it(workers: int) -> None:
    results = ordered_map(refused, [0, 1, 2], workers)
    assert next(results) == 0
    with pytest.raises(HrclogError, match="1 is refused"):
        next(results)


def test_an_exception_cancels_what_has_not_begun(tmp_path: Path) -> None:
    with pytest.raises(HrclogError, match="the first is refused"):
        list(ordered_map(partial(noted, tmp_path), range(200), 2))
    done = len(list(tmp_path.iterdir()))
    assert done < 100
    time.sleep(0.2)
    assert len(list(tmp_path.iterdir())) == done  # nothing goes on behind one's back


def test_who_asks_for_no_more_gets_no_more(tmp_path: Path) -> None:
    results = ordered_map(partial(noted, tmp_path), range(1, 200), 2)
    assert next(results) == 1
    results.close()  # type: ignore[attr-defined] - it is a generator
    assert len(list(tmp_path.iterdir())) < 100


def test_workers_end_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    script = (
        "from functools import partial; from pathlib import Path; from hrclog.parallel import ordered_map\n"
        "from parallel_work import told\n"
        f"if __name__ == '__main__': list(ordered_map(partial(told, Path({str(tmp_path)!r})), [1, 2], 2))\n"
    )
    (tmp_path / "parent.py").write_text(script)
    helpers = str(Path(__file__).parent / "helpers")
    with subprocess.Popen(
        [sys.executable, str(tmp_path / "parent.py")], env={**os.environ, "PYTHONPATH": helpers}
    ) as parent:
        workers = _when(lambda: [int(path.name[4:]) for path in tmp_path.glob("pid-*")], 2)
        parent.kill()
    assert not _when(lambda: [pid for pid in workers if Path(f"/proc/{pid}").exists()], 0)


def _when(found: Callable[[], list[int]], count: int) -> list[int]:
    """Return what is found once it has so many members, or after half a minute."""
    until = time.monotonic() + 30
    while len(found()) != count and time.monotonic() < until:
        time.sleep(0.05)
    return found()
