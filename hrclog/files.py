"""Files that are whole or absent: each is written under a hidden name beside its place, and then renamed."""

from __future__ import annotations

import errno
import os
import shutil
import stat
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Final

from hrclog.errors import HrclogError, OutputError

HIDDEN: Final = ".hrclog-*.tmp"
"""The names of what is being written; killed processes leave such files and folders behind."""

_FULL: Final = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
_OLD_S: Final = 86_400.0
"""Where no lock tells whether its process lives, what was not touched for so long is left over."""
_swept: Final[set[str]] = set()

Fill = Callable[[IO[bytes]], object]
"""Writes the bytes of a file."""

if sys.platform == "win32":  # two recorders of one file exclude each other by its creation alone

    def lock(fd: int, *, wait: bool) -> bool:  # noqa: ARG001 - the same signature everywhere
        """Return True: this system offers no lock."""
        return True

    def _is_free(fd: int) -> bool | None:  # noqa: ARG001 - the same signature everywhere
        return None

else:
    import fcntl

    def lock(fd: int, *, wait: bool) -> bool:
        """Lock an open file until it is closed; return False where somebody else has it and `wait` is off."""
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            return False
        except OSError:  # a file system without locks
            return True
        return True

    def _is_free(fd: int) -> bool | None:
        """Lock an open file; return whether nobody else has it, None where that cannot be told."""
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:
            return None
        return True


def is_at(fd: int, path: Path) -> bool:
    """Return whether an open file is the one at a path: it may have been removed, or replaced."""
    try:
        return os.path.samestat(os.fstat(fd), path.stat())
    except OSError:
        return False


def sync_folder(folder: Path) -> None:
    """Make the names in a folder survive a crash of the operating system."""
    if os.name != "posix":
        return
    fd = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)


def write_whole(path: Path, content: bytes | Fill, *, durable: bool = False, is_new: bool = False) -> None:
    """Write a file that is there whole, or not at all.

    A link stays a link: the file that it leads to is replaced. A file that is replaced keeps its permissions.

    Args:
        path: of the file, in an existing folder.
        content: its bytes, or what writes them.
        durable: whether its bytes survive a crash of the operating system; for its name see `sync_folder`.
        is_new: whether an existing file is an error.

    Raises:
        OSError: the file cannot be written; it names `path`.
    """
    target = target_of(path)
    with _errors_name(path):
        _check_replaceable(target, is_new=is_new)
        if is_device(target):
            with target.open("wb") as device:
                _fill(device, content)
            return
        if (folder := os.path.abspath(target.parent)) not in _swept:  # noqa: PTH100 - no access to the folder
            _swept.add(folder)
            sweep(target.parent)
        hidden, stream = _open_hidden(target.parent)
        keeper = os.dup(stream.fileno()) if os.name == "posix" else None  # holds the lock beyond the end of writing
        try:
            with stream:  # some network file systems tell of a full disk when a file is closed
                _fill(stream, content)
                stream.flush()
                if durable:
                    os.fsync(stream.fileno())
            put(hidden, target, is_new=is_new)
        finally:
            if keeper is not None:
                os.close(keeper)
            with suppress(OSError):
                hidden.unlink()


def write_output(path: Path, content: bytes | Fill, *, makes_folder: bool = False) -> None:
    """Write a result that is there whole, or not at all.

    Args:
        path: of the file.
        content: its bytes, or what writes them.
        makes_folder: whether its folder is made where it is missing.

    Raises:
        OutputError: the file cannot be written.
    """
    with output_errors(path):
        if makes_folder:
            path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, content)


@contextmanager
def placed(path: Path) -> Iterator[Path]:
    """Yield a path of the same name in a hidden folder; what was written there is moved to its place at the end.

    Use it where other software writes the file. What it writes beside the file is moved too.

    Raises:
        OSError: a file cannot be written.
    """
    target = target_of(path)
    with _errors_name(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        _check_replaceable(target)
        if is_device(target):
            yield target
            return
    with _errors_tell(path), hidden_folder(target.parent, shown=path.parent) as folder:
        yield folder / path.name
        for written in sorted(folder.iterdir()):
            put(written, target if written.name == path.name else target.parent / written.name)


@contextmanager
def hidden_folder(parent: Path, shown: Path | None = None) -> Iterator[Path]:
    """Yield a hidden folder that is removed at the end. Errors name its files as if they lay in `shown`, or `parent`.

    Raises:
        OSError: it cannot be made.
    """
    sweep(parent)
    folder, fd = _make_hidden(parent)
    try:
        yield folder
    except (OSError, HrclogError) as error:
        _show(error, folder, shown or parent)
        raise
    finally:
        if fd is not None:
            os.close(fd)
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def output_errors(path: Path) -> Iterator[None]:
    """Turn an OSError into an OutputError about the file that the error names, else about `path`."""
    try:
        yield
    except OSError as error:
        raise output_error(error.filename or path, error) from error


def output_error(path: Path | str, error: OSError) -> OutputError:
    """Return what is told of a result that cannot be written."""
    reason = f"cannot be written ({error.strerror or error})"
    return OutputError(path, reason, remedy_for(error, OutputError.REMEDY))


def remedy_for(error: OSError, otherwise: str) -> str:
    """Return what to do about a file that cannot be written."""
    return "free space on its disk, or choose another folder" if error.errno in _FULL else otherwise


def sweep(folder: Path) -> None:
    """Remove what killed processes left in a folder, and nothing of a process that lives."""
    with suppress(OSError):
        for path in list(folder.glob(HIDDEN)):
            with suppress(OSError):
                _remove_left(path)


def put(source: Path, target: Path, *, is_new: bool = False) -> None:
    """Move a file to its place, also where that is on another disk. What it replaces gives it its permissions.

    Raises:
        OSError: it cannot be moved; with `is_new` also if a file is there.
    """
    with suppress(OSError):
        before = target.stat()
        if os.name == "posix":
            os.chown(source, before.st_uid, before.st_gid)
            source.chmod(stat.S_IMODE(before.st_mode))
    try:
        if not (is_new and _is_linked(source, target)):
            source.replace(target)
    except OSError as error:
        if error.errno != errno.EXDEV:
            raise

        def copy(stream: IO[bytes]) -> None:
            with source.open("rb") as original:
                shutil.copyfileobj(original, stream)

        write_whole(target, copy)


def target_of(path: Path) -> Path:
    """Return the path of the file itself where a path is a link."""
    return Path(os.path.realpath(path)) if path.is_symlink() else path


def is_device(path: Path) -> bool:
    """Return whether a path is a device, a pipe or such, which is written to and never replaced."""
    try:
        mode = path.stat().st_mode
    except OSError:
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def _check_replaceable(target: Path, *, is_new: bool = False) -> None:
    """Raise where a file is to be replaced that may not be written; renaming would not ask."""
    if not target.exists():
        return
    if is_new:
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not os.access(target, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))


def _is_linked(source: Path, target: Path) -> bool:
    """Give a file another name, which no other file has; return whether its file system can do that."""
    try:
        os.link(source, target)
    except FileExistsError:
        raise
    except (OSError, NotImplementedError):
        return False
    return True


def _fill(stream: IO[bytes], content: bytes | Fill) -> None:
    if isinstance(content, bytes):
        stream.write(content)
    else:
        content(stream)


def _hidden_name() -> str:
    return f".hrclog-{os.getpid()}-{time.monotonic_ns()}.tmp"


def _open_hidden(folder: Path) -> tuple[Path, IO[bytes]]:
    while True:
        path = folder / _hidden_name()
        stream = path.open("xb")
        lock(stream.fileno(), wait=True)
        if os.name != "posix" or is_at(stream.fileno(), path):  # nobody swept it before it was locked
            return path, stream
        stream.close()


def _make_hidden(parent: Path) -> tuple[Path, int | None]:
    while True:
        path = parent / _hidden_name()
        path.mkdir()
        if os.name != "posix":
            return path, None
        try:
            fd = os.open(path, os.O_RDONLY)
        except FileNotFoundError:  # swept before it was locked
            continue
        lock(fd, wait=True)
        if is_at(fd, path):
            return path, fd
        os.close(fd)


def _remove_left(path: Path) -> None:
    is_folder = path.is_dir() and not path.is_symlink()
    free: bool | None = None
    fd = None
    try:
        if os.name == "posix":
            fd = os.open(path, os.O_RDONLY | os.O_NOFOLLOW)
            free = _is_free(fd)
        if free is None:
            free = time.time() - path.lstat().st_mtime > _OLD_S
        if free and is_folder:
            shutil.rmtree(path, ignore_errors=True)
        elif free:
            path.unlink()
    finally:
        if fd is not None:
            os.close(fd)


@contextmanager
def _errors_name(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        error.filename, error.filename2 = os.fspath(path), None
        raise


@contextmanager
def _errors_tell(path: Path) -> Iterator[None]:
    """Let errors that name no file name this one."""
    try:
        yield
    except OSError as error:
        error.filename = error.filename or os.fspath(path)
        raise


def _show(error: OSError | HrclogError, hidden: Path, shown: Path) -> None:
    """Let an error name a file by the place that it was meant for."""

    def meant(text: object) -> object:
        if isinstance(text, Path):
            return Path(str(text).replace(str(hidden), str(shown)))
        return text.replace(str(hidden), str(shown)) if isinstance(text, str) else text

    error.args = tuple(map(meant, error.args))
    if isinstance(error, OSError):
        error.filename, error.filename2 = meant(error.filename), None
    else:
        vars(error).update({name: meant(value) for name, value in vars(error).items()})
