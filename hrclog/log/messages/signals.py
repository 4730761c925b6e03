"""Messages of signal channels into samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import polars as pl
from mcap.records import Channel

from hrclog.arrays import BoolArray, ByteArray, IntArray
from hrclog.log.mcap.contents import Batch
from hrclog.log.messages import channels

SIGNAL_COLUMNS: Final = pl.Schema({"run_id": pl.String, "name": pl.String, "time_ns": pl.Int64, "value": pl.Float64})


_JOINTS: Final = "/joint_states"
_MOST_LAYOUTS: Final = 64  # beyond, messages are decoded one by one


def is_signal(channel: Channel) -> bool:
    """Return whether a channel carries a scalar signal or an agent's joints, as our writers name them."""
    is_hrc_cdr = channel.message_encoding == channels.CDR and channel.topic.startswith("/hrc/")
    return is_hrc_cdr and (channel.topic.startswith("/hrc/signals/") or channel.topic.endswith(_JOINTS))


def decode_signals(part: Batch, channel: Channel) -> pl.DataFrame:
    """Return the samples of a signal channel, columns `SIGNAL_COLUMNS`; a joint is named agent/joint."""
    run_id = channel.metadata.get("run_id", "")
    if channel.topic.endswith(_JOINTS):
        return _joints(part, channel.metadata.get("agent") or channel.topic.split("/")[-2], run_id)
    return _floats(part, channel.metadata.get("signal") or channel.topic.rsplit("/", 1)[-1], run_id)


def merged_samples(frames: Sequence[pl.DataFrame]) -> pl.DataFrame:
    """Return the samples of several files by run, name and time; those of runs in more than one file only once."""
    runs = pl.concat([frame.select(pl.col("run_id").unique()) for frame in frames])["run_id"]
    several = pl.col("run_id").is_in(runs.filter(runs.is_duplicated()).to_list())
    samples = pl.concat(frames)
    copies = samples.filter(several)
    if copies.height:  # not for all: it takes some 300 bytes a row
        samples = pl.concat([samples.filter(~several), copies.unique(maintain_order=True)])
    return samples.sort("run_id", "name", "time_ns", maintain_order=True)


def _floats(part: Batch, name: str, run_id: str) -> pl.DataFrame:
    whole = part.end - part.start >= 12
    if not whole.any():
        return pl.DataFrame(schema=SIGNAL_COLUMNS)
    windows = np.lib.stride_tricks.sliding_window_view(np.frombuffer(part.data, np.uint8), 8)
    values = np.ascontiguousarray(windows[part.start[whole] + 4]).view("<f8")[:, 0]
    return pl.DataFrame({"time_ns": part.publish_time[whole], "value": values}).select(
        pl.lit(run_id).alias("run_id"), pl.lit(name).alias("name"), "time_ns", "value"
    )


def _joints(part: Batch, agent: str, run_id: str) -> pl.DataFrame:
    frames = [SIGNAL_COLUMNS.to_frame().drop("run_id")]
    remaining = np.arange(len(part.start))
    for _ in range(_MOST_LAYOUTS):  # mostly all messages are laid out as the first one, and one turn decodes them
        if len(remaining):
            is_same = _same_layout(part, remaining)
            frames.append(_joint_samples(part, remaining[is_same], agent))
            remaining = remaining[~is_same]
    frames += [_joint_samples(part, remaining[at : at + 1], agent) for at in range(len(remaining))]
    frame = pl.concat(frames)
    return frame.select(pl.lit(run_id).alias("run_id"), *frame.columns)


def _same_layout(part: Batch, rows: IntArray) -> BoolArray:
    """Return which messages differ from the first one in stamp and values only, shape of `rows`."""
    first = part.data[part.start[rows[0]] : part.end[rows[0]]]
    try:
        _, begin, _ = channels.joint_names(first)
    except ValueError:
        return np.asarray(np.arange(len(rows)) == 0)
    is_same: BoolArray = part.end[rows] - part.start[rows] == len(first)
    heads = _windows(part, rows[is_same], 0, begin)
    heads[:, 4:12] = 0  # the stamp
    is_same[is_same] = (heads == np.frombuffer(first[:4] + bytes(8) + first[12:begin], np.uint8)).all(axis=1)
    return is_same


def _joint_samples(part: Batch, rows: IntArray, agent: str) -> pl.DataFrame:
    """Return the samples of messages laid out as the first one, without the run; none where that is damaged."""
    try:
        names, begin, count = channels.joint_names(part.data[part.start[rows[0]] : part.end[rows[0]]])
    except ValueError:
        names, begin, count = [], 0, 0
    n_joints = min(len(names), count)
    values = _windows(part, rows, begin, 8 * n_joints).view("<f8") if n_joints else np.empty((len(rows), 0))
    named = pl.Series([f"{agent}/{name}" for name in names[:n_joints]], dtype=pl.String)
    columns = {
        "name": named.gather(np.repeat(np.arange(n_joints), len(rows))),
        "time_ns": np.tile(part.publish_time[rows], n_joints),
        "value": values.T.ravel(),
    }
    return pl.DataFrame(columns, schema={name: SIGNAL_COLUMNS[name] for name in columns})


def _windows(part: Batch, rows: IntArray, begin: int, size: int) -> ByteArray:
    """Return a copy of a stretch of each message, shape (n, size)."""
    windows = np.lib.stride_tricks.sliding_window_view(np.frombuffer(part.data, np.uint8), size)
    return np.ascontiguousarray(windows[part.start[rows] + begin])
