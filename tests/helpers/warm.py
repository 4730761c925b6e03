"""The command `hrclog` without its imports: a server has them, and forks a child for each call.

Run as a script, with a socket's path, it is that server. A folder for PATH holds a client by the name `hrclog`, which
hands its arguments, its folder and its streams over and ends with the child's exit code.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Final

MODULES: Final = (
    "matplotlib.backends.backend_pdf",
    "pandas",
    "scipy.optimize",
    "scipy.special",
    "hrclog.analyzers.analysis",
    "hrclog.analyzers.comparison.compare",
    "hrclog.analyzers.learning.ingest",
    "hrclog.analyzers.prediction.score",
    "hrclog.analyzers.report.save",
    "hrclog.analyzers.rerun.save",
    "hrclog.analyzers.search.methods",
    "hrclog.knowledge",
    "hrclog.recorders.stdin",
    "hrclog.sim.campaign",
)
"""What takes long to import, besides the verbs themselves."""

_CLIENT: Final = """#!{python} -ISB
import json, os, socket, sys
server = socket.socket(socket.AF_UNIX)
server.connect({address!r})
call = json.dumps([sys.argv[1:], os.getcwd(), dict(os.environ)]).encode()
socket.send_fds(server, [len(call).to_bytes(4, "big")], [0, 1, 2])
server.sendall(call)
code = server.recv(1)
sys.exit(code[0] if code else 1)
"""
_MOST_BYTES: Final = 1 << 20
_READY: Final = b"ready\n"


def serve(address: str) -> None:
    """Answer every call by a child of its own."""
    from hrclog.cli import VERBS

    for verb in VERBS:
        with contextlib.suppress(ImportError):  # the file of a verb that is a Python word has another name
            import_module(f"hrclog.cli.{verb}")
    for module in MODULES:
        import_module(module)
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(address)
        listener.listen(16)
        os.write(1, _READY)
        while True:
            caller, _ = listener.accept()
            if not os.fork():
                listener.close()
                _answer(caller)
            caller.close()
            with contextlib.suppress(ChildProcessError):
                while os.waitpid(-1, os.WNOHANG)[0]:
                    pass


def _answer(caller: socket.socket) -> None:
    """Run a command with the streams of who called, and say its exit code."""
    code = 1
    try:
        size, streams, _, _ = socket.recv_fds(caller, 4, 3)
        call = b""
        while len(call) < int.from_bytes(size, "big"):
            call += caller.recv(_MOST_BYTES)
        arguments, folder, environment = json.loads(call)
        for number, stream in enumerate(streams):
            os.dup2(stream, number)
            os.close(stream)
        os.chdir(folder)
        os.environ.clear()
        os.environ.update(environment)
        sys.argv = ["hrclog", *arguments]
        sys.stdin, sys.stdout, sys.stderr = open(0), open(1, "w"), open(2, "w", buffering=1)  # noqa: SIM115 - streams live as long as the child
        from hrclog.cli import main

        code = main(arguments)
        sys.stdout.flush()
    finally:
        caller.send(bytes([code]))
        os._exit(code)


@contextmanager
def warm_hrclog() -> Iterator[Path]:
    """Start a server, and give a folder for PATH in which `hrclog` is its client."""
    with tempfile.TemporaryDirectory() as name:  # a path of a socket must be short
        folder = Path(name)
        address = str(folder / "socket")
        client = folder / "hrclog"
        client.write_text(_CLIENT.format(python=sys.executable, address=address), encoding="utf-8")
        client.chmod(0o755)
        with subprocess.Popen([sys.executable, __file__, address], stdout=subprocess.PIPE) as server:
            try:
                assert server.stdout is not None
                assert server.stdout.readline() == _READY, "the server did not start"
                yield folder
            finally:
                server.kill()


if __name__ == "__main__":
    serve(sys.argv[1])
