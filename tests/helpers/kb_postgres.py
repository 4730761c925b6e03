"""A private PostgreSQL server on a free port, from Debian's binaries."""

from __future__ import annotations

import os
import pwd
import shutil
import socket
import subprocess
import tempfile
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

USER = "cell"
PASSWORD = "s3cret-word"  # noqa: S105 - of a server that lives for a test


def binaries() -> Path | None:
    """Return the folder of the newest PostgreSQL server there is."""
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"), key=lambda path: int(path.parts[-3]))
    on_path = shutil.which("initdb")
    return found[-1].parent if found else Path(on_path).parent if on_path else None


class Server:
    """A running server.

    Args:
        folder: holds its cluster.
        port: that it listens on.
        programs: folder of the binaries.
        options: of the server.
    """

    def __init__(self, folder: Path, port: int, programs: Path, options: str) -> None:
        self._folder = folder
        self._options = options
        self._programs = programs
        self.port = port

    def url(self, database: str, password: str = PASSWORD) -> str:
        """Return the URL of a database."""
        return f"postgresql://{USER}:{password}@127.0.0.1:{self.port}/{database}"

    def new_schema(self) -> str:
        """Make an empty schema, which costs less than a database, and return the URL of a connection into it."""
        import psycopg

        name = f"kb_{uuid.uuid4().hex}"
        with psycopg.connect(self.url("postgres"), autocommit=True) as connection:
            connection.execute(f"CREATE SCHEMA {name}".encode())
        return f"{self.url('postgres')}?options=-csearch_path%3D{name}"

    def start(self) -> None:
        """Start it, and wait until it answers."""
        options = f"-p {self.port} -c listen_addresses=127.0.0.1 -k {self._folder} {self._options}"
        self._control("start", "-w", "-l", str(self._folder / "log"), "-o", options)

    def stop(self) -> None:
        """Stop it at once."""
        self._control("stop", "-m", "immediate")

    def _control(self, *arguments: str) -> None:
        as_postgres(self._programs / "pg_ctl", "-D", self._folder / "data", *arguments)


def as_postgres(*command: object) -> None:
    """Run a command, as a user who may run a server where this one may not."""
    arguments = [str(part) for part in command]
    if os.getuid() == 0:
        arguments = ["setpriv", f"--reuid={_user()}", f"--regid={_user()}", "--clear-groups", *arguments]
    subprocess.run(arguments, check=True, stdout=subprocess.DEVNULL, cwd="/")


def _user() -> int:
    """Return the number of a user that is not root: postgres, else nobody."""
    names = {entry.pw_name: entry.pw_uid for entry in pwd.getpwall()}
    return names.get("postgres", names.get("nobody", 65534))


@contextmanager
def private_server(programs: Path, options: str = "-c fsync=off") -> Iterator[Server]:
    """Make a cluster, run its server, and remove both at the end; nothing in it has to survive a crash."""
    folder = Path(tempfile.mkdtemp(prefix="hrclog-pg-"))  # short: a socket's path is limited
    try:
        password = folder / "password"
        password.write_text(PASSWORD)
        if os.getuid() == 0:
            for path in (folder, password):
                os.chown(path, _user(), _user())
        init = ("-U", USER, f"--pwfile={password}", "-A", "scram-sha-256", "-E", "UTF8", "--locale=C.UTF-8", "-N")
        as_postgres(programs / "initdb", "-D", folder / "data", *init)
        server = Server(folder, _free_port(), programs, options)
        server.start()
        try:
            yield server
        finally:
            server.stop()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
