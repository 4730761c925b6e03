"""Make a small log, journal, knowledge base and results by the hrclog of an old checkout.

`PYTHONPATH=CHECKOUT python tests/compat/make_with.py FOLDER`, with the checkout of a commit; see README.md.
"""

# ruff: noqa: T201 - a script
from __future__ import annotations

import gzip
import shutil
import subprocess
import sys
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

BEGAN_NS = 1_760_000_000 * 10**9
PLAN = {"name": "small", "items": [{"item_id": "r1", "agent": "robot", "task": "pick"}]}


def recorder_class() -> Any:  # noqa: ANN401 - of an hrclog of any age
    """Return the recorder."""
    try:
        return import_module("hrclog").Recorder
    except AttributeError:
        return import_module("hrclog.recorders.recorder").Recorder


def record(path: Path, *, begun_s: int, close: bool, with_tags: bool) -> None:
    """Record a run of two agents in which everything happens that an old hrclog knows."""
    now = [BEGAN_NS + begun_s * 10**9]

    def clock() -> int:
        now[0] += 10**8
        return now[0]

    facts: dict[str, Any] = {"tags": {"participant": "P01"}} if with_tags else {}
    recorder = recorder_class()(path, run=path.stem, agents=["robot", "human"], plan=PLAN, clock_ns=clock, **facts)
    for number, outcome in enumerate(("succeeded", "failed", "succeeded", "succeeded")):
        robot = recorder.start("robot", "pick", task_type="pick", details={"text": "Grüße"})
        human = recorder.start("human", "assemble")
        with suppress(AttributeError, TypeError):
            recorder.safety("robot", mode="slow", speed_scale=0.5, zone="table")
        recorder.signal("distance", number / 4)
        with suppress(AttributeError):
            recorder.joints("robot", ["elbow"], [number / 10])
        with suppress(AttributeError):
            recorder.pose("cube", (0.5, number / 10, 0.1))
        robot.pause("safety")
        robot.resume()
        robot.end(outcome, "grasp lost" if outcome == "failed" else "")
        human.end()
    if not close:
        journal = path.with_name(path.name + ".partial")
        shutil.copy(journal, path.with_name("copy"))
    recorder.close()
    if not close:
        path.unlink()
        path.with_name("copy").replace(path.with_name(path.name + ".partial"))


def make(folder: Path) -> None:
    """Make everything that this hrclog can."""
    folder = folder.absolute()
    folder.mkdir(parents=True)
    print(import_module("hrclog").__file__)
    try:
        record(folder / "run.mcap", begun_s=0, close=True, with_tags=True)
    except TypeError:
        record(folder / "run.mcap", begun_s=0, close=True, with_tags=False)
    record(folder / "killed.mcap", begun_s=100, close=False, with_tags=False)
    with suppress(Exception):
        import_module("hrclog").annotate(folder / "run.mcap", {"condition": "slow"})
    with suppress(Exception):
        runs = import_module("hrclog.log.reader").read_events([folder / "run.mcap"])["execution_id"].to_list()
        excluded = next(filter(None, runs))
        import_module("hrclog").annotate(folder / "run.mcap", exclude=[excluded], reason="a mistaken entry")
    for log in ("run.mcap", "killed.mcap.partial"):
        frame = import_module("hrclog.log.reader").read_events([folder / log])
        names = [name for name in frame.columns if name not in ("path", "log_time_ns")]
        frame.select(names).write_json(folder / f"{log}.events.json")
    hrclog = [sys.executable, "-m", "hrclog"]
    log = str(folder / "run.mcap")
    for command in (
        ["analyze", log, "-o", str(folder / "results")],
        ["kb", "ingest", "--kb", str(folder / "kb.sqlite"), log],
    ):
        done = subprocess.run([*hrclog, *command], cwd=folder, capture_output=True, text=True, check=False)
        print(command[0], done.returncode, done.stderr.strip().splitlines()[-1:])
    for path in [*folder.glob("results/**/*.rrd"), *folder.glob("results/**/*.html"), *folder.glob("**/*.svg")]:
        path.unlink()
    with suppress(OSError):
        (folder / "results" / "runs").rmdir()
    for path in [*folder.glob("*.json"), *folder.glob("*.sqlite")]:
        path.with_name(f"{path.name}.gz").write_bytes(gzip.compress(path.read_bytes(), 9, mtime=0))
        path.unlink()


if __name__ == "__main__":
    make(Path(sys.argv[1]))
