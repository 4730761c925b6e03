"""What a recovered log remembers of the file that it came from: what was lost there, where, and who recovered it.

It remembers too that no checksum covered the messages there, as its own checksums say nothing of damage from before.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

import polars as pl
from mcap.records import Metadata

from hrclog.diagnostic import Diagnostic
from hrclog.event_rows import readable_details
from hrclog.events import LATEST_NS, AnnotationAdded
from hrclog.json_text import parse_json
from hrclog.log.mcap.records import Problem
from hrclog.log.messages.message import UNSET_INT
from hrclog.log.remarks import RECOVERED, remarks_among
from hrclog.log.writing.journal import LIBRARY
from hrclog.wording import counted

NO_FOOTER: Final = "the file has no footer: its end is missing, and whatever was there"

_MAX_LISTED: Final = 100
_MAX_SHOWN: Final = 3
_MAX_DIGITS: Final = 20
_LAST_SEQ: Final = 2**62

_UNPROTECTED: Final = "unprotected"

Loss = Mapping[str, str]
"""What one recovery lost: `version`, `source`, `source_bytes`, `source_crc32`, `n_losses`, `lost_bytes`,
`lost_messages` and `losses`, a JSON list of what was lost at which offset; `unprotected` is there, and "true", where no
checksum covered the messages of the source."""


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


def of_unprotected(loss: Loss) -> Loss:
    """Add that no checksum covered the messages of the source."""
    return {**loss, _UNPROTECTED: "true"}


def loss_text(loss: Loss) -> str:
    """Say what a recovery lost."""
    n_bytes, n_messages = _number(loss, "lost_bytes"), _number(loss, "lost_messages")
    lost = [
        counted(n_bytes, "byte that could not be read", "bytes that could not be read") if n_bytes else "",
        counted(n_messages, "message that is missing", "messages that are missing") if n_messages else "",
    ]
    text = _source_text(loss)
    text += f", with {' and '.join(filter(None, lost))}" if any(lost) else ""
    places = "; ".join(_places(loss))
    return f"{text}: {places}" if places else text


def unprotected_text(loss: Loss) -> str:
    """Say that damage to the source of a recovery could not be seen."""
    return f"{_source_text(loss)}, where no checksum covered the messages: damage to them there could not be seen"


def _source_text(loss: Loss) -> str:
    source = f"{loss.get('source') or 'a damaged file'} of {counted(_number(loss, 'source_bytes'), 'byte')}"
    return f"recovered by {loss.get('version', 'hrclog')} from {source}"


def remarks_in(loss: Loss) -> list[tuple[str, str]]:
    """Return the diagnostics, code and text, that a recovery gives whenever its log is read."""
    remarks: list[tuple[str, str]] = []
    if loss.get("n_losses") != "0":
        remarks.append(("recovered_with_losses", loss_text(loss)))
    if _UNPROTECTED in loss:
        remarks.append(("unprotected", unprotected_text(loss)))
    return remarks


def _number(loss: Loss, name: str) -> int:
    text = loss.get(name, "")
    return int(text) if text.isascii() and text.isdigit() and len(text) < _MAX_DIGITS else 0


def recorded_losses(metadata: Iterable[Metadata]) -> list[str]:
    """Return what the metadata of a file say of losses at the recoveries it went through."""
    return [text for code, text in recorded_remarks(metadata) if code == "recovered_with_losses"]


def recorded_remarks(metadata: Iterable[Metadata]) -> list[tuple[str, str]]:
    """Return the diagnostics, code and text, of the recoveries that the metadata of a file tell of."""
    losses = [record.metadata for record in metadata if record.name == RECOVERED]
    return list(dict.fromkeys(remark for loss in losses for remark in remarks_in(loss)))


def annotated_losses(events: pl.DataFrame, diagnostics: Iterable[Diagnostic]) -> list[Diagnostic]:
    """Return what annotations say of recoveries that no metadata tell of: other tools keep events alone.

    Args:
        events: of all files.
        diagnostics: what is known of these files.
    """
    known = {(finding.code, finding.message) for finding in diagnostics}
    losses: dict[tuple[str, str], Diagnostic] = {}
    for row in remarks_among(events).iter_rows(named=True):
        loss = _loss_in(row["details"])
        for code, text in remarks_in(loss) if loss else []:
            if (code, text) not in known:
                place = {"path": row["path"], "run_id": row["run_id"], "seq": row["seq"]}
                losses.setdefault((code, text), Diagnostic(code, text, **place))
    return list(losses.values())


def remarks_on(loss: Loss, events: pl.DataFrame) -> list[AnnotationAdded]:
    """Return an annotation for each run that a recovered file holds, at its last event and of the same number.

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
        replace(remark(loss), run_id=run_id, seq=UNSET_INT if seq is None else seq, time_ns=time_ns)
        for run_id, seq, time_ns in ends.iter_rows()
    ]


def remark(loss: Loss) -> AnnotationAdded:
    """Return the annotation that tells of a loss, of no run and at no instant."""
    reason = "; ".join(text for _, text in remarks_in(loss))
    return AnnotationAdded(time_ns=0, reason=reason, details={RECOVERED: dict(loss)})


def _loss_in(details: str) -> Loss:
    loss = readable_details(details).get(RECOVERED)
    return {str(name): str(value) for name, value in loss.items()} if isinstance(loss, dict) else {}


def _places(loss: Loss) -> Iterator[str]:
    try:
        listed = parse_json(loss.get("losses", "[]"))
        texts = [f"byte {place['offset']}: {place['message']}" for place in listed]
    except (ValueError, TypeError, KeyError):
        return
    yield from texts[:_MAX_SHOWN]
    if len(texts) > _MAX_SHOWN:
        yield f"and {counted(len(texts) - _MAX_SHOWN, 'more place')}"
