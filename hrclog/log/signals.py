"""Messages of signal channels into samples."""

from __future__ import annotations

from typing import Final

import numpy as np
import polars as pl
from mcap.records import Channel

from hrclog.log import channels
from hrclog.log.contents import Batch

SIGNAL_COLUMNS: Final = pl.Schema({"run_id": pl.String, "name": pl.String, "time_ns": pl.Int64, "value": pl.Float64})

_JOINTS: Final = "/joint_states"


def is_signal(channel: Channel) -> bool:
    """Return whether a channel carries a scalar signal or an agent's joints, as our writers name them."""
    ours = channel.message_encoding == channels.CDR and channel.topic.startswith("/hrc/")
    return ours and (channel.topic.startswith("/hrc/signals/") or channel.topic.endswith(_JOINTS))


def decode_signals(part: Batch, channel: Channel) -> pl.DataFrame:
    """Return the samples of a signal channel, columns `SIGNAL_COLUMNS`; a joint is named agent/joint."""
    run_id = channel.metadata.get("run_id", "")
    if channel.topic.endswith(_JOINTS):
        return _joints(part, channel.metadata.get("agent") or channel.topic.split("/")[-2], run_id)
    return _floats(part, channel.metadata.get("signal") or channel.topic.rsplit("/", 1)[-1], run_id)


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
    rows: list[tuple[str, str, int, float]] = []
    for start, end, time_ns in zip(part.start.tolist(), part.end.tolist(), part.publish_time.tolist(), strict=True):
        try:
            names, positions = channels.decode_joints(part.data[start:end])
        except ValueError:
            continue
        rows += [(run_id, f"{agent}/{name}", time_ns, value) for name, value in zip(names, positions, strict=False)]
    return pl.DataFrame(rows, schema=SIGNAL_COLUMNS, orient="row")
