"""The cell of a run in progress: its recorded scene, and what has moved since it was last drawn."""

from __future__ import annotations

import polars as pl

from hrclog.analyzers.figures.cell import CellFigure
from hrclog.log.messages.recorded_scene import POSE_COLUMNS, RecordedScene, RunScene
from hrclog.log.messages.signals import SIGNAL_COLUMNS
from hrclog.scene import Scene


class LiveCell:
    """The cell of one run; `has_news` while something is not drawn yet.

    Args:
        run_id: the run of the cell.
    """

    def __init__(self, run_id: str) -> None:
        self._run_id = run_id
        self._scene: Scene | None = None
        self._descriptions: dict[str, str] = {}
        self._poses = POSE_COLUMNS.to_frame()
        self._posed_ns = -1
        self._firsts = SIGNAL_COLUMNS.to_frame()
        self._outline: CellFigure | None = None
        self.has_news = False

    def take(self, said: RecordedScene) -> None:
        """Take in new parts of the scene. Of two scenes or descriptions, the first counts."""
        self._scene = self._scene or said.scenes.get(self._run_id)
        for (run_id, agent), text in said.descriptions.items():
            if run_id == self._run_id:
                self._descriptions.setdefault(agent, text)
        poses = said.poses.filter(pl.col("run_id") == self._run_id)
        self.has_news |= bool(said.scenes or said.descriptions or poses.height)
        if poses.height:
            self._poses = pl.concat([self._poses, poses])
            self._posed_ns = max(self._posed_ns, int(poses["time_ns"].max()))  # type: ignore[arg-type]  # an int64 column

    def unseen(self, said: RecordedScene) -> RecordedScene:
        """Return a log's scene without the poses that were taken in already."""
        return RecordedScene(said.scenes, said.descriptions, said.poses.filter(pl.col("time_ns") > self._posed_ns))

    def sampled(self, signals: pl.DataFrame) -> None:
        """Remember the first sample of each signal."""
        firsts = signals.unique("name", keep="first", maintain_order=True)
        self._firsts = pl.concat([self._firsts, firsts.filter(~pl.col("name").is_in(self._firsts["name"].to_list()))])

    def samples(self, signals: pl.DataFrame) -> pl.DataFrame:
        """Return new samples and the first ones of all joints: before its first sample, a joint stands there."""
        bodies = pl.col("name").str.replace(r"/[^/]*$", "").is_in(list(self._descriptions))
        return pl.concat([self._firsts.filter(bodies), signals]).unique(maintain_order=True)

    def scene(self) -> RunScene | None:
        """Return the cell with its new poses, None if there is no cell. Poses alone are no cell."""
        if self._scene is None and not self._descriptions:
            return None
        self.has_news = False
        poses, self._poses = self._poses, POSE_COLUMNS.to_frame()
        return RunScene(self._scene or Scene(), self._descriptions, poses)

    def outline(self, figure: CellFigure | None) -> CellFigure | None:
        """Return the cell as it was first drawn."""
        self._outline = self._outline or figure
        return self._outline
