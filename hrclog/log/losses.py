"""What a recovered log remembers of the file that it came from: what was lost there, where, and who recovered it."""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final

import polars as pl
from mcap.records import Metadata

from hrclog.diagnostic import Diagnostic
from hrclog.errors import InvalidEventError
from hrclog.event_rows import parse_details
from hrclog.events import LATEST_NS, AnnotationAdded
from hrclog.log.mcap.records import Problem
from hrclog.log.messages.message import UNSET_INT
from hrclog.log.writing.journal import LIBRARY
from hrclog.wording import counted

RECOVERED: Final = "hrclog.recovered"
"""Name of the metadata record, and of the member in the details of an annotation, that hold what was lost."""

NO_FOOTER: Final = "the file has no footer: its end is missing, and whatever was there"

_MAX_LISTED: Final = 100
_MAX_SHOWN: Final = 3
_MAX_DIGITS: Final = 20
_LAST_SEQ: Final = 2**62

Loss = Mapping[str, str]
"""What one recovery lost: `version`, `source`, `source_bytes`, `source_crc32`, `n_losses`, `lost_bytes`,
`lost_messages` and `losses`, a JSON list of what was lost at which offset."""


def loss_of(source: Path, data: bytes, problems: list[Problem]) -> Loss:
    """Return what a recovery has to tell of its source; `losses` lists the first hundred."""
    listed = [
        {
            "offset": problem.offset,
            "bytes": problem.n_bytes,
            "messages": problem.n_messages,
            "code": problem.code,
            "message": problem.message,
        }
        for problem in problems[:_MAX_LISTED]
    ]
    return {
        "version": LIBRARY,
        "source": source.name.encode(errors="replace").decode(),
        "source_bytes": str(len(data)),
        "source_crc32": f"{zlib.crc32(data):08x}",
        "n_losses": str(len(problems)),
        "lost_bytes": str(sum(problem.n_bytes for problem in problems)),
        "lost_messages": str(sum(problem.n_messages for problem in problems)),
        "losses": json.dumps(listed, ensure_ascii=False),
    }


def loss_text(loss: Loss) -> str:
    """Say what a recovery lost."""
    n_bytes, n_messages = _number(loss, "lost_bytes"), _number(loss, "lost_messages")
    lost = [
        counted(n_bytes, "byte that could not be read", "bytes that could not be read") if n_bytes else "",
        counted(n_messages, "message that is missing", "messages that are missing") if n_messages else "",
    ]
    source = f"{loss.get('source') or 'a damaged file'} of {counted(_number(loss, 'source_bytes'), 'byte')}"
    text = f"recovered by {loss.get('version', 'hrclog')} from {source}"
    text += f", with {' and '.join(filter(None, lost))}" if any(lost) else ""
    places = "; ".join(_places(loss))
    return f"{text}: {places}" if places else text


def _number(loss: Loss, name: str) -> int:
    text = loss.get(name, "")
    return int(text) if text.isascii() and text.isdigit() and len(text) < _MAX_DIGITS else 0


def recorded_losses(metadata: Iterable[Metadata]) -> list[str]:
    """Return what the metadata of a file say of the recoveries it went through."""
    return list(dict.fromkeys(loss_text(record.metadata) for record in metadata if record.name == RECOVERED))


def annotated_losses(events: pl.DataFrame, diagnostics: Iterable[Diagnostic]) -> list[Diagnostic]:
    """Return what annotations say of recoveries that no metadata tell of: other tools keep events alone.

    Args:
        events: of all files.
        diagnostics: what is known of these files.
    """
    known = {finding.message for finding in diagnostics if finding.code == "recovered_with_losses"}
    remarks = events.filter(pl.col("kind") == AnnotationAdded.kind)
    remarks = remarks.filter(pl.col("details").str.contains(f'"{RECOVERED}"', literal=True))
    losses: dict[str, Diagnostic] = {}
    for row in remarks.iter_rows(named=True):
        loss = _loss_in(row["details"])
        text = loss_text(loss)
        if loss and text not in known:
            place = {"path": row["path"], "run_id": row["run_id"], "seq": row["seq"]}
            losses.setdefault(text, Diagnostic("recovered_with_losses", text, **place))
    return list(losses.values())


def remarks_on(loss: Loss, events: pl.DataFrame) -> list[AnnotationAdded]:
    """Return an annotation for each run that a recovered file holds, behind its last event.

    Args:
        loss: what was lost.
        events: of the file.
    """
    placed = events.filter(
        pl.col("time_ns").is_between(0, LATEST_NS)
        & pl.col("seq").is_between(0, _LAST_SEQ).fill_null(value=True)
        & pl.col("run_id").is_not_null()
    )
    ends = placed.group_by("run_id", maintain_order=True).agg(pl.col("seq").max(), pl.col("time_ns").max())
    return [
        AnnotationAdded(
            run_id=run_id,
            seq=UNSET_INT if seq is None else seq + 1,
            time_ns=time_ns,
            reason=loss_text(loss),
            details={RECOVERED: dict(loss)},
        )
        for run_id, seq, time_ns in ends.iter_rows()
    ]


def _loss_in(details: str) -> Loss:
    try:
        loss = parse_details(details).get(RECOVERED)
    except InvalidEventError:
        loss = None
    return {str(name): str(value) for name, value in loss.items()} if isinstance(loss, dict) else {}


def _places(loss: Loss) -> Iterator[str]:
    try:
        listed = json.loads(loss.get("losses", "[]"))
        texts = [f"byte {place['offset']}: {place['message']}" for place in listed]
    except (ValueError, TypeError, KeyError, RecursionError):
        return
    yield from texts[:_MAX_SHOWN]
    if len(texts) > _MAX_SHOWN:
        yield f"and {counted(len(texts) - _MAX_SHOWN, 'more place')}"
