"""What a file may ask of its reader: one table of limits, and one budget per file that is spent before memory is taken.

A limit grows with the size of the file as it lies on the disk, and has a floor, so that small files can hold what small
files hold. Files that are written to log something stay far below: they unpack to a fifth of the limit at most.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

MIB: Final = 1 << 20


@dataclass(frozen=True, slots=True)
class Limit:
    """How much of something a file may hold.

    Attributes:
        name: of what is counted, in the plural.
        least: what any file may hold, however small.
        per_byte: what it may hold more for each byte of it, above that.
        most: what no file may hold.
        ends_reading: whether nothing behind the place where it is reached is read.
    """

    name: str
    least: int
    per_byte: float = 0.0
    most: int = 1 << 62
    ends_reading: bool = True

    def of(self, n_bytes: int) -> int:
        """Return how much a file of a size may hold."""
        return min(self.most, max(self.least, int(self.per_byte * n_bytes)))


UNPACKED: Final = Limit("bytes once unpacked", 32 * MIB, 32, ends_reading=False)
CHUNK: Final = Limit("bytes of one chunk once unpacked", 32 * MIB, 16, 256 * MIB, ends_reading=False)
WHOLE_FILE: Final = Limit("bytes once the whole file is unpacked", 32 * MIB, 32, 1 << 31)
UNPACKED_DUMP: Final = Limit("bytes of a dump of JSON once it is unpacked", 64 * MIB, 100, 1 << 30)
CHECKED: Final = Limit("bytes that are checked for being a chunk, and are none", 64 * MIB, 16)
RECORDS: Final = Limit("records in chunks", 250_000, 1 / 8)
FRAME: Final = Limit("records outside of chunks", 100_000, 1 / 32)
DECLARATIONS: Final = Limit("different declarations and metadata", 20_000, 1 / 512)
CHANNELS: Final = Limit("channels", 4096)
EVENT_CHANNELS: Final = Limit("channels of events", 1024)
DEFINITION: Final = Limit("characters of one definition", 100_000)
STATEMENTS: Final = Limit("statements of one definition", 1000)
EVENT_STATEMENTS: Final = Limit("statements of all definitions of events", 2000)
ELEMENTS: Final = Limit("numbers that one message of fixed length holds", 1_000_000)
UNROLLED: Final = Limit("texts and messages in the arrays of fixed length of one definition", 500)
EVENT: Final = Limit("bytes of one event", 8 * MIB)
ROW: Final = Limit("bytes of one row", MIB, 1)
STEPS: Final = Limit("steps of the database", 20_000_000, 20)

LIMITS: Final = (
    UNPACKED,
    CHUNK,
    WHOLE_FILE,
    UNPACKED_DUMP,
    CHECKED,
    RECORDS,
    FRAME,
    DECLARATIONS,
    CHANNELS,
    EVENT_CHANNELS,
    DEFINITION,
    STATEMENTS,
    EVENT_STATEMENTS,
    ELEMENTS,
    UNROLLED,
    EVENT,
    ROW,
    STEPS,
)
"""All limits of logs and bags, as `docs/reliability.md` lists them."""


class LimitError(ValueError):
    """A file asks for more than its limit; the text says which, and for how much."""

    def __init__(self, limit: Limit, found: int, most: int) -> None:
        self.limit = limit
        super().__init__(f"limit reached: {found:,} {limit.name}, expected at most {most:,}")


class Budget:
    """What the reader of one file may still spend.

    Args:
        n_bytes: of the file on the disk; None sets no limit that grows with a file.
    """

    __slots__ = ("_left", "_n_bytes")

    def __init__(self, n_bytes: int | None) -> None:
        self._n_bytes = n_bytes
        self._left: dict[str, int] = {}

    def fresh(self) -> Budget:
        """Return the budget of the same file, of which nothing is spent."""
        return Budget(self._n_bytes)

    def most(self, limit: Limit) -> int:
        """Return the value of a limit."""
        return limit.most if self._n_bytes is None else limit.of(self._n_bytes)

    def left(self, limit: Limit) -> int:
        """Return how much of a limit is left."""
        left = self._left.get(limit.name)
        return self.most(limit) if left is None else left

    def check(self, limit: Limit, number: int) -> None:
        """Raise if one thing is larger than a limit.

        Raises:
            LimitError: it is.
        """
        if number > limit.least and number > self.most(limit):
            raise LimitError(limit, number, self.most(limit))

    def spend(self, limit: Limit, number: int = 1) -> None:
        """Take something off a limit.

        Raises:
            LimitError: so much is not left; nothing is taken off.
        """
        left = self._left.get(limit.name)
        if left is None:
            left = self.most(limit)
        if number > left:
            raise LimitError(limit, self.most(limit) - left + number, self.most(limit))
        self._left[limit.name] = left - number
