"""File names for names that people give: safe on every system, short enough, still readable."""

from __future__ import annotations

import re
from typing import Final

_UNSAFE: Final = re.compile(r"[^\w.+-]+")


def file_stem(name: str, longest: int) -> str:
    """Return a name without what file systems refuse, at most `longest` bytes of UTF-8; "" if nothing is left."""
    return _UNSAFE.sub("_", name).strip(".").encode()[:longest].decode(errors="ignore")
