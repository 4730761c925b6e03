"""SIGKILL while runs are taken in: only whole runs are there, and going on gives what never being killed gives."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from kb_runs import state_at
from kb_work import ingest_runs
from sizes import many

from hrclog.knowledge import open_knowledge

pytestmark = [pytest.mark.slow, pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork and SIGKILL")]

HELPERS = Path(__file__).parents[1] / "helpers"
SERVER = """
import os, sys
from kb_work import ingest_runs

for line in sys.stdin:
    where, step = line.rstrip("\\n").split("\\t")
    child = os.fork()
    if not child:
        ingest_runs(where, list(range(100)), int(step))
        os._exit(0)
    print(child, flush=True)
    sys.stdin.readline()  # until then a child that has ended keeps its number
    os.waitpid(child, 0)
    print("reaped", flush=True)
"""


class Killer:
    """A process that forks others, so that none has to import anything."""

    def __init__(self) -> None:
        environment = os.environ | {"PYTHONPATH": str(HELPERS)}
        streams = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        self._process = subprocess.Popen([sys.executable, "-c", SERVER], env=environment, **streams)

    def ingest_and_kill(self, where: str, step: int, after_s: float) -> None:
        """Let a process take 100 runs in, and kill it after a time."""
        child = int(self._ask(f"{where}\t{step}"))
        time.sleep(after_s)
        os.kill(child, signal.SIGKILL)
        assert self._ask("reap") == "reaped\n"

    def _ask(self, line: str) -> str:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{line}\n")
        self._process.stdin.flush()
        answer: str = self._process.stdout.readline()
        return answer

    def close(self) -> None:
        """Let the process end."""
        self._process.communicate()


@pytest.fixture(scope="module")
def killer() -> Iterator[Killer]:
    found = Killer()
    yield found
    found.close()


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[tuple[str, ...]]]:
    """Return the state of a knowledge base whose making nobody disturbed."""
    where = tmp_path_factory.mktemp("undisturbed") / "kb.sqlite"
    ingest_runs(str(where), list(range(100)), 100)
    return state_at(where)


def _check_whole(where: str) -> int:
    """Check that what is there is whole, and return how many runs are."""
    with open_knowledge(where, create=True) as kb, kb.view() as view:  # it may be killed before there is anything
        runs, results, made = view.runs(), view.results(), view.statistics()
        durations = view.durations()
    assert Counter(results["run_id"]) == {run.run_id: run.n_executions for run in runs}
    assert {run.n_executions for run in runs} <= {4}
    if made:
        assert set(durations["count"] + durations["n_failed"]) == {len(made.runs)}
    return len(runs)


@pytest.mark.parametrize("step", [100, 7])
def test_what_a_kill_leaves_is_whole_and_going_on_completes_it(
    killer: Killer, expected: object, tmp_path: Path, step: int
) -> None:
    chance = random.Random(step)
    counts: list[int] = []
    for number in range(100):
        if number >= many(16, fuzz=60) and any(0 < count < 100 for count in counts):
            break  # on a busy machine few kills come in the midst of a job
        where = str(tmp_path / f"{number}.sqlite")
        killer.ingest_and_kill(where, step, chance.uniform(0.0, 0.6))
        counts.append(_check_whole(where))
        if number % 5 == 0:
            ingest_runs(where, list(range(100)), 50)
            assert state_at(where) == expected
    assert any(0 < count < 100 for count in counts)


def test_many_kills_of_one_knowledge_base_do_it_no_harm(killer: Killer, expected: object, where: str) -> None:
    chance = random.Random(where[:4])
    before = 0
    for _ in range(many(15, fuzz=250)):
        killer.ingest_and_kill(where, 20, chance.uniform(0.0, 0.25))
        now = _check_whole(where)
        assert now >= before
        before = now
    ingest_runs(where, list(range(100)), 50)
    assert state_at(where) == expected
