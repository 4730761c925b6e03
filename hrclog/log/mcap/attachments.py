"""Attachments: files that an MCAP file holds beside its messages, each with a checksum of its own."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from typing import Final

_TIMES: Final = struct.Struct("<QQ")  # log time, creation time
_SIZE: Final = struct.Struct("<I")
_LONG_SIZE: Final = struct.Struct("<Q")


@dataclass(frozen=True, slots=True)
class Attachment:
    """An attachment; its content lies in the file from `start` to `end`, and `is_intact` unless its checksum fails."""

    name: str
    media_type: str
    log_time: int
    create_time: int
    start: int
    end: int
    is_intact: bool


def attachment_at(data: bytes, start: int, end: int) -> Attachment:
    """Return the attachment that is the content of a record, from its first byte to one past its last.

    A wrong checksum is told by `is_intact`, as long as the sizes fill the record, so that they are right.

    Raises:
        ValueError: its sizes do not fit into the record.
    """
    name, at = _text(data, start + _TIMES.size, end)
    media_type, at = _text(data, at, end)
    content = at + _LONG_SIZE.size
    content_end = content + _LONG_SIZE.unpack_from(data, at)[0] if content <= end else end
    if content_end + _SIZE.size > end:
        raise ValueError("an Attachment record is damaged")
    (checksum,) = _SIZE.unpack_from(data, content_end)
    # the format counts 0 as no checksum
    is_intact = checksum in (0, zlib.crc32(memoryview(data)[start:content_end]))
    if not is_intact and content_end + _SIZE.size != end:
        raise ValueError("an Attachment record is damaged")
    log_time, create_time = _TIMES.unpack_from(data, start)
    return Attachment(name, media_type, log_time, create_time, content, content_end, is_intact)


def _text(data: bytes, at: int, end: int) -> tuple[str, int]:
    """Return a text with its size before it, and where it ends."""
    begin = at + _SIZE.size
    text_end = begin + _SIZE.unpack_from(data, at)[0] if begin <= end else end + 1
    if text_end > end:
        raise ValueError("an Attachment record is damaged")
    return data[begin:text_end].decode(), text_end


def damage_text(attachment: Attachment) -> str:
    """Say that an attachment is damaged."""
    return f"the attachment {attachment.name!r} fails its checksum"
