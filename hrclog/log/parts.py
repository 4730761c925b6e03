"""Decode a file by what it is, or each part of a bag; what is doubtful or lost on the way is a diagnostic."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import polars as pl

from hrclog.diagnostic import Diagnostic
from hrclog.errors import LogReadError
from hrclog.log.bags.folder import open_bag
from hrclog.log.files.formats import HEAD_BYTES, Format, foreign_error
from hrclog.log.files.names import BAG_METADATA, plain_name
from hrclog.log.files.unpack import load
from hrclog.log.limits import Budget
from hrclog.log.losses import NO_FOOTER, recorded_remarks
from hrclog.log.mcap.contents import Contents, Wanted
from hrclog.log.mcap.indexed import read_contents
from hrclog.log.mcap.records import MAGIC
from hrclog.log.messages.decode import (
    EVENT_COLUMNS,
    Decoded,
    decode_contents,
    foreign_types,
    is_event_channel,
    is_wanted,
)
from hrclog.log.messages.failures import Complain
from hrclog.log.writing.journal import PARTIAL_SUFFIX
from hrclog.wording import counted

_MOST_RUNS: Final = 5  # named in a message
_MOST_PROBLEMS: Final = 1000  # of one file that are told one by one


def complaints(path: Path, diagnostics: list[Diagnostic]) -> Complain:
    """Return what takes complaints about a file into a list."""

    def complain(code: str, text: str, offset: int | None) -> None:
        diagnostics.append(Diagnostic(code, text, str(path), offset=offset))

    return complain


def decode_bag(folder: Path, diagnostics: list[Diagnostic], *, signals: bool) -> dict[Path, Decoded]:
    """Decode the parts of a ROS 2 bag, each by itself: a bad one costs only itself.

    Args:
        folder: the bag.
        diagnostics: takes what is lost or doubtful.
        signals: whether signals and scene are wanted too.

    Raises:
        LogReadError: no part can be read.
    """
    bag = open_bag(folder)
    diagnostics += [
        Diagnostic("missing_part", f"{BAG_METADATA} lists this file, which is not there", str(folder / name))
        for name in bag.missing
    ]
    decoded: dict[Path, Decoded] = {}
    failures: list[LogReadError] = []
    for part in bag.parts:
        try:
            decoded[part] = decode_file(part, complaints(part, diagnostics), signals=signals)
        except LogReadError as error:
            size = counted(part.stat().st_size, "byte was", "bytes were")
            text = f"{error.reason}; none of its {size} read"
            diagnostics.append(Diagnostic("unreadable_file", text, str(part)))
            failures.append(error)
    if not decoded:
        description = f"a bag none of whose {counted(len(failures), 'part')} can be read, the first: {failures[0]}"
        raise LogReadError(folder, description, "at least one part that can")
    return decoded


def decode_file(path: Path, complain: Complain, *, signals: bool) -> Decoded:
    """Decode one file, by what it is and not by its name.

    Args:
        path: the file.
        complain: takes what is lost or doubtful.
        signals: whether signals and scene are wanted too.

    Raises:
        LogReadError: it cannot be opened, or is no event log at all.
    """
    wanted = is_wanted if signals else is_event_channel
    contents = read_part(path, wanted, complain)
    for topic, kind in foreign_types(contents):
        complain("foreign_type", f"{topic} carries {kind}, which is no event: its messages were not read", None)
    decoded = decode_contents(contents, complain, signals=signals)
    if path.name.endswith(PARTIAL_SUFFIX) and contents.is_ours:
        _report_several_runs(decoded.events, complain)
    return decoded


def read_part(path: Path, wanted: Wanted, complain: Complain, *, mapped: bool = False) -> Contents:
    """Read the wanted messages of one file, by what it is and not by its name.

    Args:
        path: the file.
        wanted: says of a channel and its schema whether its messages are needed.
        complain: takes what is lost or doubtful.
        mapped: whether to map the file into memory, and to believe an index that says where nothing is wanted.

    Raises:
        LogReadError: it cannot be opened, or is no log or bag at all.
    """
    if not path.is_file():
        raise LogReadError(path, "something that is no regular file", "an event log")
    file = load(path, mapped=mapped)
    if file.kind is Format.RERUN or path.suffix == ".rrd":
        raise foreign_error(path, file.data[:HEAD_BYTES])
    if file.kind is Format.SQLITE:
        from hrclog.log.bags.sqlite import read_database

        contents = read_database(path, wanted, file.data or None, file.budget)
    elif file.kind is Format.ROS1:
        from hrclog.log.bags.ros1 import read_ros1

        contents = read_ros1(path, file.data, wanted, file.budget, by_index=mapped)
    else:
        contents = _read_mcap(path, file.data, wanted, file.budget)
    contents.problems[:0] = file.problems
    _tell_of_contents(path, contents, complain)
    return contents


def _tell_of_contents(path: Path, contents: Contents, complain: Complain) -> None:
    for problem in contents.problems[:_MOST_PROBLEMS]:
        complain(problem.code, problem.message, problem.offset)
    untold = contents.problems[_MOST_PROBLEMS:]
    if untold:
        text = counted(len(untold), "more problem of this file is", "more problems of this file are")
        complain("corrupt_data", f"{text} not listed; the first is at this byte", untold[0].offset)
    if contents.unprotected:
        complain("unprotected", "no checksum covers the messages of this file: damage to them cannot be seen", None)
    for code, text in recorded_remarks(contents.metadata):
        complain(code, text, None)
    if not contents.finished:
        _tell_of_the_end(path, contents, complain)


def _report_several_runs(events: list[pl.DataFrame], complain: Complain) -> None:
    """Report that a journal holds more than the one run that a recorder writes into it."""
    run_ids = pl.concat([EVENT_COLUMNS.to_frame().select("run_id"), *(frame.select("run_id") for frame in events)])
    if run_ids["run_id"].n_unique() > 1:
        runs = run_ids.group_by("run_id", maintain_order=True).len().rows()
        parts = ", ".join(f"{n_events:,} of {run_id!r}" for run_id, n_events in runs[:_MOST_RUNS])
        text = f"the journal holds events of {len(runs)} runs ({parts}), expected one: parts of another file are in it"
        complain("foreign_records", text, None)


def _tell_of_the_end(path: Path, contents: Contents, complain: Complain) -> None:
    codes = {problem.code for problem in contents.problems}
    if "no_header" in codes:
        return
    if plain_name(path.name).endswith(PARTIAL_SUFFIX):
        complain("unfinished_log", "the log was not closed; `hrclog recover` closes it", None)
    elif not codes & {"truncated", "limit_reached"}:
        complain("truncated", NO_FOOTER, None)


def _read_mcap(path: Path, data: bytes, wanted: Wanted, budget: Budget) -> Contents:
    contents = read_contents(data, wanted, budget)
    # a kill before or within the magic bytes leaves a prefix of them
    if contents.header is None and not contents.batches and not (data.startswith(MAGIC) or MAGIC.startswith(data)):
        raise foreign_error(path, data[:HEAD_BYTES])
    return contents
