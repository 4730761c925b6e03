"""Messages of scene channels into what is known of the cell of each run."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import polars as pl
from mcap.records import Channel

from hrclog.arrays import BoolArray, IntArray
from hrclog.log.mcap.contents import Batch
from hrclog.log.messages import channels
from hrclog.log.messages.signals import merged_samples
from hrclog.scene import FARTHEST_M, QUATERNION_NORMS, Scene, parse_scene
from hrclog.wording import counted

POSE_COLUMNS: Final = pl.Schema(
    {"run_id": pl.String, "name": pl.String, "time_ns": pl.Int64}
    | dict.fromkeys(("x", "y", "z", "qx", "qy", "qz", "qw"), pl.Float64)
)
TEXT_COLUMNS: Final = pl.Schema({"run_id": pl.String, "agent": pl.String, "time_ns": pl.Int64, "text": pl.String})
MAX_BYTES: Final = 10_000_000
"""Longest scene or description that is read."""

_DESCRIPTION: Final = "/description"
_POSE: Final = "/pose"
_POSE_BYTES: Final = 56
_POSE_START: Final = 12  # encapsulation header and stamp

Tell = Callable[[str], None]
"""Takes what had to be left out."""


@dataclass(frozen=True, slots=True)
class RunScene:
    """The cell of one run; `poses` has `POSE_COLUMNS`, `descriptions` are URDF by agent."""

    scene: Scene
    descriptions: Mapping[str, str]
    poses: pl.DataFrame


@dataclass(frozen=True, slots=True)
class RecordedScene:
    """The cells of all runs: scenes by run, URDF by run and agent, poses (`POSE_COLUMNS`) by run, name and time."""

    scenes: Mapping[str, Scene] = field(default_factory=dict)
    descriptions: Mapping[tuple[str, str], str] = field(default_factory=dict)
    poses: pl.DataFrame = field(default_factory=POSE_COLUMNS.to_frame)

    def only(self, runs: Collection[str]) -> RecordedScene:
        """Return the cells of some runs."""
        return RecordedScene(
            {run: scene for run, scene in self.scenes.items() if run in runs},
            {(run, agent): text for (run, agent), text in self.descriptions.items() if run in runs},
            self.poses.filter(pl.col("run_id").is_in(list(runs))),
        )

    def of_run(self, run_id: str) -> RunScene | None:
        """Return the cell of a run, None where none was recorded; poses alone are none."""
        descriptions = {agent: text for (run, agent), text in self.descriptions.items() if run == run_id}
        if run_id not in self.scenes and not descriptions:
            return None
        poses = self.poses.filter(pl.col("run_id") == run_id)
        return RunScene(self.scenes.get(run_id, Scene()), descriptions, poses)


@dataclass(slots=True)
class SceneParts:
    """What was decoded of one file, in pieces: frames of `TEXT_COLUMNS` (scenes have no agent) and `POSE_COLUMNS`."""

    scenes: list[pl.DataFrame] = field(default_factory=list)
    descriptions: list[pl.DataFrame] = field(default_factory=list)
    poses: list[pl.DataFrame] = field(default_factory=list)

    def take(self, part: Batch, channel: Channel, tell: Tell) -> None:
        """Decode messages of a scene channel."""
        run_id = channel.metadata.get("run_id", "")
        if channel.topic == channels.SCENE_TOPIC:
            self.scenes.append(_texts(part, "", run_id, tell))
        elif channel.topic.endswith(_DESCRIPTION):
            agent = channel.metadata.get("agent") or channel.topic.split("/")[-2]
            self.descriptions.append(_texts(part, agent, run_id, tell))
        else:
            name = channel.metadata.get("object") or channel.topic.split("/")[-2]
            self.poses.append(_poses(part, name, run_id, tell))


def is_scene(channel: Channel) -> bool:
    """Return whether a channel carries a scene, a robot description or an object's poses, as our writers name them."""
    topic = channel.topic
    return channel.message_encoding == channels.CDR and (
        topic == channels.SCENE_TOPIC
        or (topic.startswith("/hrc/agents/") and topic.endswith(_DESCRIPTION))
        or (topic.startswith("/hrc/objects/") and topic.endswith(_POSE))
    )


def recorded_scene(parts: SceneParts, run_id: str | None, tell: Tell) -> RecordedScene:
    """Return what one file says.

    Args:
        parts: its messages.
        run_id: the only run of the file, for parts that name none; None where there are several.
        tell: told what is left out.
    """
    if not (parts.scenes or parts.descriptions or parts.poses):  # as in most files: frames of nothing take their time
        return RecordedScene()
    scenes, descriptions, poses = (
        _with_run(pl.concat(frames) if frames else schema.to_frame(), run_id)
        for frames, schema in (
            (parts.scenes, TEXT_COLUMNS),
            (parts.descriptions, TEXT_COLUMNS),
            (parts.poses, POSE_COLUMNS),
        )
    )
    parsed: dict[str, Scene] = {}
    for run, _, _, text in _first(scenes).iter_rows():
        parsed[run], problems = parse_scene(text)
        if problems:
            others = f" (and {counted(len(problems) - 1, 'further problem')})" if len(problems) > 1 else ""
            tell(f"of a scene something was left out: {problems[0]}{others}")
    urdfs = {(run, agent): text for run, agent, _, text in _first(descriptions).iter_rows()}
    return RecordedScene(parsed, urdfs, poses)


def merged(scenes: Iterable[RecordedScene]) -> RecordedScene:
    """Return what several files say; of two scenes or descriptions of a run the first file's counts."""
    by_run: dict[str, Scene] = {}
    urdfs: dict[tuple[str, str], str] = {}
    frames: list[pl.DataFrame] = []
    for scene in scenes:
        by_run = {**scene.scenes, **by_run}
        urdfs = {**scene.descriptions, **urdfs}
        frames.append(scene.poses)
    return RecordedScene(by_run, urdfs, merged_samples(frames))


def _with_run(frame: pl.DataFrame, run_id: str | None) -> pl.DataFrame:
    if run_id is None:
        return frame
    return frame.with_columns(pl.when(pl.col("run_id") == "").then(pl.lit(run_id)).otherwise("run_id").alias("run_id"))


def _first(texts: pl.DataFrame) -> pl.DataFrame:
    return texts.sort("time_ns", maintain_order=True).unique(["run_id", "agent"], keep="first", maintain_order=True)


def _texts(part: Batch, agent: str, run_id: str, tell: Tell) -> pl.DataFrame:
    rows: list[tuple[str, str, int, str]] = []
    for start, end, time_ns in zip(part.start.tolist(), part.end.tolist(), part.publish_time.tolist(), strict=True):
        try:
            rows.append((run_id, agent, time_ns, _text(part.data[start:end])))
        except ValueError as error:
            tell(f"the {f'description of {agent!r}' if agent else 'scene'} was left out: {error}")
    return pl.DataFrame(rows, schema=TEXT_COLUMNS, orient="row")


def _text(data: bytes) -> str:
    if len(data) > MAX_BYTES:
        raise ValueError(f"found {len(data)} bytes, expected at most {MAX_BYTES}")
    return channels.decode_string(data)


def _poses(part: Batch, name: str, run_id: str, tell: Tell) -> pl.DataFrame:
    whole = _whole_poses(part)
    values = np.empty((0, 7))
    if whole.any():
        windows = np.lib.stride_tricks.sliding_window_view(np.frombuffer(part.data, np.uint8), _POSE_BYTES)
        values = np.ascontiguousarray(windows[part.end[whole] - _POSE_BYTES]).view("<f8")
    least, most = QUATERNION_NORMS
    with np.errstate(invalid="ignore", over="ignore"):
        norm = np.linalg.norm(values[:, 3:], axis=1)
        valid = (np.abs(values[:, :3]) <= FARTHEST_M).all(axis=1) & (norm > least) & (norm < most)
    left_out = len(part.start) - int(valid.sum())
    if left_out:
        omitted = counted(
            left_out, f"pose of {name!r} was left out: it is", f"poses of {name!r} were left out: they are"
        )
        tell(f"{omitted} damaged or no finite numbers")
    values = values[valid]
    values[:, 3:] /= norm[valid, None]
    columns = dict(zip(POSE_COLUMNS.names()[3:], values.T, strict=True))
    frame = pl.DataFrame({"time_ns": part.publish_time[whole][valid]} | columns)
    return frame.select(pl.lit(run_id).alias("run_id"), pl.lit(name).alias("name"), *frame.columns)


def _whole_poses(part: Batch) -> BoolArray:
    """Return which messages are as long as their frame's name says."""
    size = part.end - part.start
    whole = size >= _POSE_START + 4 + _POSE_BYTES
    if not whole.any():
        return whole
    heads = np.lib.stride_tricks.sliding_window_view(np.frombuffer(part.data, np.uint8), 4)
    named: IntArray = np.zeros(len(size), np.int64)
    named[whole] = np.ascontiguousarray(heads[part.start[whole] + _POSE_START]).view("<u4")[:, 0]
    whole[whole] = (heads[part.start[whole]] == np.frombuffer(channels.LITTLE, np.uint8)).all(axis=1)
    body = _POSE_START + named  # its length without the encapsulation header, up to the end of the frame's name
    return np.asarray(whole & (size == 4 + body + -body % 8 + _POSE_BYTES))
