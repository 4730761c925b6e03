"""Something that somebody says of a run, as the details of an annotation hold it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Final

from hrclog.event_rows import readable_details
from hrclog.log.annotations.targets import Target, target_from_json
from hrclog.log.remarks import ANNOTATED
from hrclog.tags import TAGS

_AT_NS: Final = "at_ns"
_AUTHOR: Final = "author"
_JUDGEMENTS: Final = "judgements"


class Verdict(StrEnum):
    """What somebody says of what was recorded."""

    EXCLUDED = "excluded"  # it did not happen: a mistaken entry
    NOT_LEARNT = "not_learnt"  # it happened, and nothing is to be learnt from it
    INCLUDED = "included"  # what was said of it is taken back


@dataclass(frozen=True, slots=True)
class Said:
    """Something that somebody says of a run.

    Attributes:
        tags: by key; an empty value takes a tag back.
        judgements: by what they are about.
        reason: why, or a note.
        author: who says it, "" where that is not told.
        at_ns: when, ns since the epoch.
    """

    tags: Mapping[str, str] = field(default_factory=dict)
    judgements: Mapping[Target, Verdict] = field(default_factory=dict)
    reason: str = ""
    author: str = ""
    at_ns: int = 0

    def details(self) -> dict[str, Any]:
        """Return the details of the annotation that says it; the reason is its text."""
        content: dict[str, Any] = {_AT_NS: self.at_ns}
        if self.author:
            content[_AUTHOR] = self.author
        if self.tags:
            content[TAGS] = dict(self.tags)
        if self.judgements:
            content[_JUDGEMENTS] = [
                {"verdict": str(verdict), **target.to_json()} for target, verdict in self.judgements.items()
            ]
        return {ANNOTATED: content}


def said_in(details: str, reason: str = "") -> Said:
    """Return what the details of an annotation say; what has another form says nothing.

    Args:
        details: its details, JSON.
        reason: its text.
    """
    content = readable_details(details).get(ANNOTATED)
    if not isinstance(content, dict):
        return Said(reason=reason)
    author, at_ns = content.get(_AUTHOR), content.get(_AT_NS)
    return Said(
        _texts(content.get(TAGS)),
        _judgements(content.get(_JUDGEMENTS)),
        reason,
        author if isinstance(author, str) else "",
        at_ns if isinstance(at_ns, int) else 0,
    )


def _texts(value: object) -> dict[str, str]:
    entries = value.items() if isinstance(value, dict) else ()
    return {key: entry for key, entry in entries if isinstance(entry, str)}


def _judgements(value: object) -> dict[Target, Verdict]:
    judgements: dict[Target, Verdict] = {}
    for entry in value if isinstance(value, list) else ():
        target = target_from_json(entry)
        if target is not None and entry.get("verdict") in tuple(Verdict):
            judgements[target] = Verdict(entry["verdict"])
    return judgements
