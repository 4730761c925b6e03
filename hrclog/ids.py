"""Identifiers: UUIDv7 for new things, UUIDv5 for things derived from a source."""

from __future__ import annotations

import hashlib
import os
import threading
import time
import uuid
from collections.abc import Callable

from hrclog.forks import renew_after_fork

NAMESPACE = uuid.uuid5(uuid.NAMESPACE_URL, "hrclog")
"""Root of all derived identifiers."""

_RANDOM_BITS = 74


def derived_id(*parts: str) -> str:
    """Return the UUIDv5 of a source's parts, the same for the same parts.

    Args:
        parts: the source's key, outermost first; parts may hold any character.
    """
    text = "".join([f"{len(part)}:{part}" for part in parts])
    # `uuid.uuid5` by hand: an import makes one for each row
    digest = bytearray(hashlib.sha1(NAMESPACE.bytes + text.encode(), usedforsecurity=False).digest()[:16])
    digest[6] = digest[6] & 0x0F | 0x50
    digest[8] = digest[8] & 0x3F | 0x80
    letters = digest.hex()
    return f"{letters[:8]}-{letters[8:12]}-{letters[12:16]}-{letters[16:20]}-{letters[20:]}"


class Uuid7Generator:
    """Make UUIDv7 (RFC 9562) that sort in the order in which they were made.

    Args:
        clock_ns: wall clock, nanoseconds since the epoch.
        random_bits: draws an integer of that many random bits; seed it for reproducible ids.
    """

    def __init__(
        self,
        clock_ns: Callable[[], int] = time.time_ns,
        random_bits: Callable[[int], int] = lambda bits: int.from_bytes(os.urandom(16)) >> (128 - bits),
    ) -> None:
        self._clock_ns = clock_ns
        self._random_bits = random_bits
        self._lock = threading.Lock()
        self._last_ms = -1
        self._tail = 0
        renew_after_fork(self)

    def renew_after_fork(self) -> None:
        """Make the lock anew: a thread of the process that was forked may have held it."""
        self._lock = threading.Lock()

    def __call__(self) -> str:
        """Return a new identifier, larger than all before it."""
        with self._lock:
            now_ms = max(self._clock_ns() // 1_000_000, 0)
            if now_ms > self._last_ms:
                self._last_ms = now_ms
                # the top random bit stays free, so that counting up in one millisecond does not overflow
                self._tail = self._random_bits(_RANDOM_BITS - 1)
            else:
                self._tail += 1 + self._random_bits(32)
            return str(_uuid7(self._last_ms, self._tail))


def _uuid7(unix_ms: int, tail: int) -> uuid.UUID:
    rand_a, rand_b = tail >> 62 & 0xFFF, tail & (1 << 62) - 1
    value = (unix_ms & (1 << 48) - 1) << 80 | 0x7 << 76 | rand_a << 64 | 0b10 << 62 | rand_b
    return uuid.UUID(int=value)


new_id = Uuid7Generator()
"""Return a new UUIDv7 of this process."""
