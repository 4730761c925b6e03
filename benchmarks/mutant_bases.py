"""Whole files to be damaged: a recorder's journal and closed log, and the same messages in other forms of MCAP."""

from __future__ import annotations

import io
from itertools import count
from pathlib import Path
from typing import Final
from unittest.mock import patch

from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from mutants import MAGIC, Base, records

from hrclog.log.one_log import read_log
from hrclog.log.writing.journal import journal_path
from hrclog.recorders.recorder import Recorder

_T0: Final = 1_700_000_000 * 10**9
_N_TASKS: Final = 50
_CHUNK_SIZE: Final = 4096

_FORMS: Final[dict[str, tuple[CompressionType, bool, bool]]] = {
    # name: compression, chunked, with checksums
    "lz4": (CompressionType.LZ4, True, True),
    "uncompressed": (CompressionType.NONE, True, True),
    "zstd of another recorder": (CompressionType.ZSTD, True, True),
    "zstd, no checksum": (CompressionType.ZSTD, True, False),
    "lz4, no checksum": (CompressionType.LZ4, True, False),
    "uncompressed, no checksum": (CompressionType.NONE, True, False),
    "unchunked, no checksum": (CompressionType.NONE, False, False),
}
_OWN: Final = ("lz4", "uncompressed")
"""Forms that name hrclog as their recorder; it writes a checksum with every chunk, so the others cannot."""
_OTHER: Final = "another recorder"


def make_bases(folder: Path) -> list[Base]:
    """Record two runs in a folder and return the first in each form, beside the second."""
    journal, closed = _recorded(folder / "first.mcap", 1)
    other_journal, other_closed = _recorded(folder / "second.mcap", 2)
    bases = [
        Base("journal", journal, other_journal, protected=True),
        Base("journal, no checksum", _unfinished(closed), _unfinished(other_closed), protected=False),
        Base("zstd", closed, other_closed, protected=True),
    ]
    for name, (compression, chunked, crcs) in _FORMS.items():
        library = "" if name in _OWN else _OTHER
        data, other = (
            _rewritten(source, compression, library, chunked=chunked, crcs=crcs) for source in (closed, other_closed)
        )
        bases.append(Base(name, data, other, protected=crcs))
    return bases


def _recorded(path: Path, seed: int) -> tuple[bytes, bytes]:
    """Return the journal of a run shortly before its end, and its closed log."""
    began = _T0 + seed * 86_400 * 10**9
    ticks = iter(range(began, began + 10**15, 10**8))
    ids = (f"{seed:08d}-0000-7000-8000-{number:012d}" for number in count())
    with (
        patch("hrclog.recorders.segments.new_id", lambda: next(ids)),
        patch("hrclog.log.writing.writer._CHUNK_SIZE", _CHUNK_SIZE, create=True),
    ):
        recorder = Recorder(path, f"run {seed}", agents=["robot", "human"], clock_ns=lambda: next(ticks))
        for i in range(_N_TASKS):
            robot = recorder.start("robot", f"pick {i % 5}", execution_id=next(ids))
            human = recorder.start("human", f"screw {i % 3}", execution_id=next(ids), details={"grip": i / 7})
            recorder.signal("distance", i / 10)
            robot.end()
            recorder.joints("robot", ["elbow", "wrist"], [i / 3, -i])
            human.end("failed" if i % 9 == 4 else "succeeded")
        journal = journal_path(path).read_bytes()
        recorder.close()
    return journal, path.read_bytes()


def _unfinished(source: bytes) -> bytes:
    """Return a file without an end whose every message is an uncompressed chunk without a checksum."""
    whole = _rewritten(source, CompressionType.NONE, _OTHER, chunked=True, crcs=False, chunk_size=1)
    return whole[: next(begin for begin, _ in records(whole) if whole[begin] == Opcode.DATA_END)]


def _rewritten(
    source: bytes,
    compression: CompressionType,
    library: str,
    *,
    chunked: bool,
    crcs: bool,
    chunk_size: int = _CHUNK_SIZE,
) -> bytes:
    """Return the same messages in another form."""
    reader = make_reader(io.BytesIO(source))
    header = reader.get_header()
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=chunk_size, compression=compression, use_chunking=chunked, enable_crcs=crcs)
    writer.start(header.profile, library or header.library)
    ids: dict[int, int] = {}
    for schema, channel, message in reader.iter_messages(log_time_order=False):
        if channel.id not in ids:
            schema_id = writer.register_schema(schema.name, schema.encoding, schema.data) if schema else 0
            ids[channel.id] = writer.register_channel(
                channel.topic, channel.message_encoding, schema_id, channel.metadata
            )
        writer.add_message(ids[channel.id], message.log_time, message.data, message.publish_time, message.sequence)
    for metadata in reader.iter_metadata():
        writer.add_metadata(metadata.name, metadata.metadata)
    writer.finish()
    return stream.getvalue()


def whole_or_raise(base: Base, path: Path) -> None:
    """Raise if a base is not read in full.

    Raises:
        RuntimeError: it has errors, or holds no events; the figures would mean nothing.
    """
    path.write_bytes(base.data)
    logs = read_log(path, signals=True)
    errors = [str(finding) for finding in logs.diagnostics if finding.severity == "error"]
    if errors or logs.events.height < 4 * _N_TASKS or logs.signals.is_empty() or not base.data.startswith(MAGIC):
        raise RuntimeError(f"the base {base.name!r} is not whole: {errors[:3]}")
