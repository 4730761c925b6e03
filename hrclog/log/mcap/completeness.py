"""Whether a file holds what it says it holds: nothing missing, nothing doubled, nothing of another file."""

from __future__ import annotations

import zlib
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

from mcap.opcode import Opcode
from mcap.records import ChunkIndex, DataEnd, Footer, Statistics

from hrclog.log.mcap.frame import ChunkKey, Frame, Listing, chunk_key, has_checked_chunk, index_key, unchecked_chunks
from hrclog.log.mcap.records import PREFIX, Problem, Record, expand
from hrclog.wording import agree, counted

Misfit = tuple[int, str]
"""Where and how an index does not fit its file."""

_ONCE: Final = (Opcode.HEADER, Opcode.DATA_END, Opcode.STATISTICS, Opcode.FOOTER)
_MOST_TOPICS: Final = 5  # named in a message


@dataclass(frozen=True, slots=True)
class Match:
    """Which chunks an index lists, and which there are.

    Attributes:
        at_home: first byte and index of each chunk that lies where its index says.
        moved: first bytes of chunks that lie elsewhere, each with its index.
        missing: indexes of chunks that are not there, or damaged.
        unlisted: first bytes of chunks that no index lists.
    """

    at_home: list[tuple[int, ChunkIndex]] = field(default_factory=list)
    moved: list[tuple[int, ChunkIndex]] = field(default_factory=list)
    missing: list[ChunkIndex] = field(default_factory=list)
    unlisted: list[int] = field(default_factory=list)


def match_chunks(data: bytes, frame: Frame, said: Listing) -> Match:
    """Compare the chunks of a file with those that its index lists."""
    match = Match()
    if not said.chunk_indexes:
        return match
    there: dict[int, ChunkKey] = {offset: chunk_key(data, offset) for offset in frame.chunks}
    astray: list[ChunkIndex] = []
    for _, index in said.chunk_indexes:
        if there.get(index.chunk_start_offset) == index_key(index):
            del there[index.chunk_start_offset]
            match.at_home.append((index.chunk_start_offset, index))
        else:
            astray.append(index)
    elsewhere: defaultdict[ChunkKey, list[int]] = defaultdict(list)
    for offset, key in reversed(there.items()):
        elsewhere[key].append(offset)
    for index in astray:
        places = elsewhere[index_key(index)]
        if places:
            match.moved.append((places.pop(), index))
        else:
            match.missing.append(index)
    match.unlisted.extend(sorted(offset for places in elsewhere.values() for offset in places))
    return match


def frame_problems(
    data: bytes, frame: Frame, said: Listing, match: Match, misfits: Iterable[Misfit] = ()
) -> list[Problem]:
    """Return what of a file's frame does not fit together.

    Args:
        data: the file.
        frame: the records that are there.
        said: what the file says.
        match: which of the chunks that the index lists are there.
        misfits: what else of the index does not fit.
    """
    misfits = [
        *misfits,
        *section_misfits(data, frame, said),
        *_chunk_misfits(frame, match),
        *_record_misfits(frame, said),
    ]
    return [
        *_strangers(frame, said),
        *_unlisted(match),
        *_without_checksum(data, frame),
        *([_misfit(misfits)] if misfits else []),
    ]


def data_problems(data: bytes, said: Listing) -> list[Problem]:
    """Return whether the checksum of the data section is wrong."""
    return [
        Problem("corrupt_data", offset, "the data section fails its checksum: bytes before this one were changed")
        for offset, data_end in said.data_ends
        if data_end.data_section_crc and zlib.crc32(memoryview(data)[:offset]) != data_end.data_section_crc
    ]


def count_problems(
    frame: Frame, said: Listing, match: Match, messages: Mapping[int, int], topics: Mapping[int, str]
) -> list[Problem]:
    """Return what is there less or more often than a file says.

    Args:
        frame: the records that are there.
        said: what the file says.
        match: which of the chunks that the index lists are there.
        messages: how many there are, by channel; those of channels that are not named were not counted.
        topics: of channels.
    """
    lost, extra = _differences([statistics for _, statistics in said.statistics], messages)
    problems: list[Problem] = []
    gone = [index.chunk_start_offset for index in match.missing if index.chunk_start_offset not in frame.damaged]
    at = min(gone, default=min(frame.damaged, default=next(iter(said.statistics), (0, None))[0]))
    if gone:
        n_lost = sum(lost.values())
        holds = f" of together {counted(n_lost, 'message')}" if len(gone) > 1 else f" of {counted(n_lost, 'message')}"
        which = _by_topic(lost, topics)
        text = f"{counted(len(gone), 'chunk')}{holds if said.statistics else ''}{which} that the index lists"
        verb = agree(len(gone), "is not there; it was", "are not there; the first was")
        damaged = " (those of damaged chunks are among them)" if frame.damaged else ""
        problems.append(Problem("records_missing", at, f"{text} {verb} at this byte{damaged}", n_messages=n_lost))
    elif lost:
        n_lost = sum(lost.values())
        text = counted(n_lost, "message that the file counts is", "messages that the file counts are")
        problems.append(Problem("records_missing", at, f"{text} not there{_by_topic(lost, topics)}", n_messages=n_lost))
    if extra:
        text = counted(sum(extra.values()), "message is", "messages are")
        text = f"{text} there that the file does not count{_by_topic(extra, topics)}"
        problems.append(Problem("foreign_records", said.statistics[0][0], f"{text}; they were kept"))
    return [*problems, *_other_differences(frame, said)]


def _differences(
    statistics: Iterable[Statistics], messages: Mapping[int, int]
) -> tuple[dict[int, int], dict[int, int]]:
    """Return how many messages are missing and how many too many, by channel, -1 where that is not known."""
    lost: dict[int, int] = {}
    extra: dict[int, int] = {}
    for counts in statistics:
        expected = dict(counts.channel_message_counts)
        there: dict[int, int] = dict(messages)
        if sum(expected.values()) != counts.message_count:
            expected, there = {-1: counts.message_count}, {-1: sum(messages.values())}
        for channel, n_messages in there.items():
            surplus = n_messages - expected.get(channel, 0)
            if surplus > 0:
                extra[channel] = surplus
            elif surplus < 0:
                lost[channel] = -surplus
    return lost, extra


def _by_topic(counts: Mapping[int, int], topics: Mapping[int, str]) -> str:
    named = [(number, topics.get(channel, f"channel {channel}")) for channel, number in counts.items() if channel >= 0]
    if not named:
        return ""
    parts = [f"{number:,} on {topic}" for number, topic in named[:_MOST_TOPICS]]
    rest = sum(number for number, _ in named[_MOST_TOPICS:])
    return f" ({', '.join([*parts, f'{rest:,} on others'] if rest else parts)})"


def _other_differences(frame: Frame, said: Listing) -> Iterator[Problem]:
    n_chunks = len(frame.chunks) + len(frame.damaged)
    n_metadata, n_attachments = (len(frame.of(opcode)) for opcode in (Opcode.METADATA, Opcode.ATTACHMENT))
    for at, statistics in said.statistics:
        for name, n_there, n_said in (
            ("chunk", n_chunks, statistics.chunk_count if not said.chunk_indexes else n_chunks),
            ("metadata record", n_metadata, statistics.metadata_count),
            ("attachment", n_attachments, statistics.attachment_count),
        ):
            if n_there < n_said:
                text = counted(n_said - n_there, f"{name} that the file counts is", f"{name}s that the file counts are")
                yield Problem("records_missing", at, f"{text} not there")
            elif n_there > n_said:
                text = counted(n_there - n_said, f"{name} is", f"{name}s are")
                yield Problem("foreign_records", at, f"{text} there that the file does not count")


def _strangers(frame: Frame, said: Listing) -> Iterator[Problem]:
    """Find records that can be in a file only once, or not where they are."""
    for opcode in _ONCE:
        records = frame.of(opcode)
        if len(records) > 1:
            name = opcode.name.lower().replace("_", " ")
            text = f"the file has {len(records)} records of kind {name}, expected one: it holds parts of another file"
            yield Problem("foreign_records", records[1][1], text)
    if said.data_ends:
        end = said.data_ends[0][0]
        behind = [offset for offset in frame.chunks if offset > end]
        if behind:
            text = counted(len(behind), "chunk lies", "chunks lie")
            yield Problem("foreign_records", behind[0], f"{text} behind the end of the data; the first begins here")


def _unlisted(match: Match) -> Iterator[Problem]:
    if match.unlisted:
        n_unlisted = len(match.unlisted)
        text = counted(n_unlisted, "chunk is", "chunks are")
        text = f"{text} there that the index does not list; {agree(n_unlisted, 'its', 'their')} messages were kept"
        yield Problem("foreign_records", match.unlisted[0], text)


def _without_checksum(data: bytes, frame: Frame) -> Iterator[Problem]:
    if not has_checked_chunk(data, frame):
        return
    offsets = [offset for offset in unchecked_chunks(data, frame) if _checksum(data, offset)]
    if offsets:
        text = counted(len(offsets), "chunk has", "chunks have")
        text = f"{text} no checksum, though others have one; what it held was kept, unchecked"
        yield Problem("corrupt_data", offsets[0], text)


def _checksum(data: bytes, offset: int) -> int:
    """Return the true checksum of a readable chunk; it may be 0."""
    length = int.from_bytes(data[offset + 1 : offset + PREFIX.size], "little")
    begin = offset + PREFIX.size
    buffer, start, end = expand(data, (int(Opcode.CHUNK), offset, begin, begin + length))
    return zlib.crc32(memoryview(buffer)[start:end])


def section_misfits(data: bytes, frame: Frame, said: Listing) -> Iterator[Misfit]:
    """Say of the footer and the end of the data where they do not fit."""
    if len(said.footers) != 1 or len(said.data_ends) > 1:
        return
    footer_at, footer = said.footers[0]
    if not said.data_ends:
        yield footer_at, "the record that ends the data is not there"
        return
    yield from _footer_misfits(data, frame, footer_at, footer, said.data_ends[0])


def _footer_misfits(
    data: bytes, frame: Frame, footer_at: int, footer: Footer, data_end: tuple[int, DataEnd]
) -> Iterator[Misfit]:
    summary_at = frame.others[data_end[0]][3]
    summary = [record for offset, record in frame.others.items() if summary_at <= offset < footer_at]
    if footer.summary_start not in ((summary_at,) if summary else (0, summary_at)):
        yield footer_at, f"the footer has the summary at byte {footer.summary_start}, which is at {summary_at}"
    offsets_at = [record[1] for record in summary if record[0] == Opcode.SUMMARY_OFFSET]
    if footer.summary_offset_start and offsets_at and footer.summary_offset_start != offsets_at[0]:
        text = f"the footer has the summary's offsets at byte {footer.summary_offset_start}"
        yield footer_at, f"{text}, which are at {offsets_at[0]}"
    crc_at = footer_at + PREFIX.size + 16
    if footer.summary_crc and zlib.crc32(data[min(summary_at, footer_at) : crc_at]) != footer.summary_crc:
        yield footer_at, "the summary fails its checksum"


def _chunk_misfits(frame: Frame, match: Match) -> Iterator[Misfit]:
    if match.moved:
        (offset, index), n_moved = match.moved[0], len(match.moved)
        text = f"it leads {counted(n_moved, 'chunk')} astray, the first to byte {index.chunk_start_offset}"
        yield offset, f"{text} instead of {offset}"
    for offset, index in match.at_home:
        for channel, at in index.message_index_offsets.items():
            record = frame.others.get(at)
            if record is None or record[0] != Opcode.MESSAGE_INDEX:
                yield offset, f"there is no message index of channel {channel} at byte {at}"
                return


def _record_misfits(frame: Frame, said: Listing) -> Iterator[Misfit]:
    """Say which indexes lead to no record of their kind."""
    for at, metadata in said.metadata_indexes:
        if not _is_at(frame, metadata.offset, Opcode.METADATA, metadata.length):
            yield at, f"there is no metadata record of {counted(metadata.length, 'byte')} at byte {metadata.offset}"
    for at, attachment in said.attachment_indexes:
        if not _is_at(frame, attachment.offset, Opcode.ATTACHMENT, attachment.length):
            yield at, f"there is no attachment of {counted(attachment.length, 'byte')} at byte {attachment.offset}"
    for at, group in said.summary_offsets:
        if group.group_length and not _is_at(frame, group.group_start, group.group_opcode):
            yield at, f"there is no record of kind {group.group_opcode} at byte {group.group_start}"


def _is_at(frame: Frame, offset: int, opcode: int, length: int | None = None) -> bool:
    record: Record | None = frame.others.get(offset)
    return record is not None and record[0] == opcode and length in (None, record[3] - record[1])


def _misfit(misfits: list[Misfit]) -> Problem:
    more = f", and {counted(len(misfits) - 1, 'more misfit')}" if len(misfits) > 1 else ""
    text = f"the index does not fit the file: {misfits[0][1]}{more}; the records themselves were read"
    return Problem("damaged_index", misfits[0][0], text)
