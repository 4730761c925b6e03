"""Something that somebody says of a run, as the details of an annotation hold it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from hrclog.errors import InvalidEventError
from hrclog.event_rows import parse_details
from hrclog.log.remarks import ANNOTATED
from hrclog.tags import TAGS

_AT_NS: Final = "at_ns"
_AUTHOR: Final = "author"


@dataclass(frozen=True, slots=True)
class Said:
    """Something that somebody says of a run.

    Attributes:
        tags: by key; an empty value takes a tag back.
        author: who says it, "" where that is not told.
        at_ns: when, ns since the epoch.
    """

    tags: Mapping[str, str]
    author: str = ""
    at_ns: int = 0

    def details(self) -> dict[str, Any]:
        """Return the details of the annotation that says it."""
        author = {_AUTHOR: self.author} if self.author else {}
        return {ANNOTATED: {_AT_NS: self.at_ns, TAGS: dict(self.tags), **author}}


def said_in(details: str) -> Said:
    """Return what the details of an annotation say; what has another form says nothing."""
    try:
        content = parse_details(details).get(ANNOTATED)
    except InvalidEventError:
        content = None
    if not isinstance(content, dict):
        return Said({})
    tags, author, at_ns = content.get(TAGS), content.get(_AUTHOR), content.get(_AT_NS)
    return Said(
        {key: value for key, value in tags.items() if isinstance(value, str)} if isinstance(tags, dict) else {},
        author if isinstance(author, str) else "",
        at_ns if isinstance(at_ns, int) else 0,
    )
