"""Which topics a file or a part of a bag has, with their types and how many messages; no message is decoded."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from hrclog.errors import LogReadError
from hrclog.log.bags.folder import is_bag, open_bag
from hrclog.log.files.formats import Format
from hrclog.log.files.unpack import load
from hrclog.log.mcap.describe import describe
from hrclog.log.mcap.description import Description
from hrclog.log.messages.definitions import type_name
from hrclog.log.parts import read_part


@dataclass(frozen=True, slots=True)
class TopicFacts:
    """A topic of a recording; `type` and `encoding` are "" where it tells none."""

    topic: str
    type: str
    encoding: str
    n_messages: int


@dataclass(frozen=True, slots=True)
class PartFacts:
    """What a file is, and its topics by name; `description` is all that there is to say of an MCAP file."""

    kind: Format
    topics: list[TopicFacts]
    description: Description | None = None


def parts_at(path: Path) -> list[Path]:
    """Return the file itself, or the parts of a bag."""
    try:
        return open_bag(path).parts if is_bag(path) else [path]
    except LogReadError:
        return []


def part_facts(path: Path) -> PartFacts | None:
    """Return what a file is, None where it is no recording that can be read."""
    try:
        file = load(path)
        is_mcap = file.kind in (Format.MCAP, Format.OTHER)  # a torn one may begin with anything
        description = describe(file.data, file.budget) if is_mcap else None
        if description is not None:
            return PartFacts(Format.MCAP, _of_description(description), description)
        contents = read_part(path, lambda _channel, _schema: False, lambda *_: None, mapped=True)
    except LogReadError:
        return None
    counts: Counter[tuple[str, str, str]] = Counter()
    for channel in contents.channels.values():
        schema = contents.schemas.get(channel.schema_id)
        kind = type_name(schema.name) if schema is not None else ""
        counts[channel.topic, kind, channel.message_encoding] += contents.counts.get(channel.id, 0)
    return PartFacts(file.kind, _facts(counts))


def all_topics(parts: Iterable[PartFacts]) -> list[TopicFacts]:
    """Return the topics of all parts of a recording."""
    counts: Counter[tuple[str, str, str]] = Counter()
    for part in parts:
        for facts in part.topics:
            counts[facts.topic, facts.type, facts.encoding] += facts.n_messages
    return _facts(counts)


def _of_description(description: Description) -> list[TopicFacts]:
    counts: Counter[tuple[str, str, str]] = Counter()
    for channel in description.channels:
        counts[channel.topic, channel.schema or "", channel.message_encoding] += channel.n_messages
    return _facts(counts)


def _facts(counts: Counter[tuple[str, str, str]]) -> list[TopicFacts]:
    return [TopicFacts(*names, count) for names, count in sorted(counts.items())]
