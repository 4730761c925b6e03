"""The first bytes of a file without its compression: by them importers tell whether it may be one of theirs."""

from __future__ import annotations

import zlib
from typing import Final

HEAD_BYTES: Final = 1 << 16
"""So many first bytes of a file are looked at."""

_GZIP: Final = b"\x1f\x8b"
_ZSTD: Final = b"\x28\xb5\x2f\xfd"


def without_compression(head: bytes) -> bytes:
    """Return the first bytes of what a file holds, b"" where they cannot be unpacked.

    Args:
        head: the first bytes of the file.
    """
    try:
        if head.startswith(_GZIP):
            return zlib.decompressobj(zlib.MAX_WBITS | 16).decompress(head, HEAD_BYTES)
        if head.startswith(_ZSTD):
            import zstandard

            with zstandard.ZstdDecompressor().stream_reader(head) as stream:
                return stream.read(HEAD_BYTES)
    except (zlib.error, MemoryError):
        return b""
    except Exception as error:
        if type(error).__name__ != "ZstdError":
            raise
        return b""
    return head
