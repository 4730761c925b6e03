"""What kind of file this is, by its first bytes: names mislead, and recorders and tools rename files."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Final

from hrclog.errors import NoLogError
from hrclog.log.mcap.records import MAGIC

HEAD_BYTES: Final = 64
"""So many first bytes tell a format."""

ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"


class Format(Enum):
    """A kind of file; the value says what it is."""

    MCAP = "an MCAP log"
    SQLITE = "an SQLite file"
    ROS1 = "a ROS 1 bag"
    ZSTD = "a file compressed with zstd"
    GZIP = "a file compressed with gzip"
    PACKED = "a compressed file or archive"
    OFFICE = "a workbook or another office document"
    RERUN = "a Rerun recording"
    OTHER = "a file of an unknown kind"


_ARCHIVE: Final = b"PK\x03\x04"
_OLD_OFFICE: Final = b"\xd0\xcf\x11\xe0"
_OFFICE_PARTS: Final = (b"[Content_Types].xml", b"_rels/", b"docProps/", b"xl/", b"mimetypeapplication/vnd.oasis")
"""Names of what the archive of a document begins with."""

_BEGINNINGS: Final = (
    (b"SQLite format 3\x00", Format.SQLITE),
    (b"#ROSBAG V", Format.ROS1),
    (ZSTD_MAGIC, Format.ZSTD),
    (b"\x1f\x8b\x08", Format.GZIP),
    (b"BZh", Format.PACKED),
    (b"\xfd7zXZ\x00", Format.PACKED),
    (b"\x04\x22\x4d\x18", Format.PACKED),  # lz4
    (_ARCHIVE, Format.PACKED),
    (b"7z\xbc\xaf\x27\x1c", Format.PACKED),
    (b"RRF", Format.RERUN),
)


def recognise(head: bytes) -> Format:
    """Return the format of a file.

    Args:
        head: its first `HEAD_BYTES` bytes, or all it has. A kill leaves MCAP files that end within their first bytes.
    """
    if head.startswith(MAGIC) or MAGIC.startswith(head):
        return Format.MCAP
    if head.startswith(_OLD_OFFICE) or (head.startswith(_ARCHIVE) and any(name in head for name in _OFFICE_PARTS)):
        return Format.OFFICE
    return next((kind for beginning, kind in _BEGINNINGS if head.startswith(beginning)), Format.OTHER)


def foreign_error(path: Path, head: bytes) -> NoLogError:
    """Return the error for a file that is no log."""
    kind = Format.RERUN if path.suffix == ".rrd" else recognise(head)
    if kind is Format.RERUN:
        return NoLogError(path, kind.value, "an event log", f"open it with `hrclog view {path}`")
    if kind is Format.OFFICE:
        return NoLogError(path, kind.value, "an MCAP log or a ROS bag")
    if kind is Format.PACKED:
        return NoLogError(path, kind.value, "a log, as it is or with zstd or gzip", "unpack it first")
    return NoLogError(path, f"a file that begins with {head[:8]!r}", "an MCAP log or a ROS bag")
