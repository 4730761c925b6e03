"""Make killed.mcap.partial: a recorder that the kernel kills in the middle of a write.

The process limits the size of its files. The write that would go past the limit is cut off there, and the signal that
follows ends the process, as a power cut or an out-of-memory kill would.
"""

from __future__ import annotations

import os
import resource
import signal
import sys
from itertools import count
from pathlib import Path

from hrclog import Recorder

FILE_SIZE = 10_700
FIRST_NS = 1_700_000_000_000_000_000


def main(path: Path) -> int:
    """Record until killed, in a child process; return 0 if it was."""
    child = os.fork()
    if not child:
        signal.signal(signal.SIGXFSZ, signal.SIG_DFL)
        resource.setrlimit(resource.RLIMIT_FSIZE, (FILE_SIZE, FILE_SIZE))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        _record(path)
    _, status = os.waitpid(child, 0)
    return 0 if os.WIFSIGNALED(status) else 1


def _record(path: Path) -> None:
    clock = count(FIRST_NS, 750_000_000)
    recorder = Recorder(path, run="killed", agents=("human", "robot"), clock_ns=lambda: next(clock))
    while True:
        robot = recorder.start("robot", "pick_orange_box")
        human = recorder.start("human", "pick_white_box")
        robot.end()
        human.end()


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
