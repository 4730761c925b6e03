"""Streams into a viewer while runs are recorded: a growing recording per run, and one of all runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint import archetypes as rrba

from hrclog.analyzers.drawing import Picture
from hrclog.analyzers.figures.campaign import CampaignFigures
from hrclog.analyzers.figures.palette import CARD
from hrclog.analyzers.figures.plot import Page
from hrclog.analyzers.figures.run import RunFigures
from hrclog.analyzers.live.lanes import LaneKey, LaneNews
from hrclog.analyzers.live.run import LivePart
from hrclog.analyzers.rerun.layout import campaign_blueprint, run_blueprint
from hrclog.analyzers.rerun.recording import TIMELINE, Layout, freed_recordings, times
from hrclog.analyzers.rerun.save import (
    CAMPAIGN_APPLICATION,
    campaign_pictures,
    lane_path,
    run_application,
    send_campaign,
    send_rows,
    send_run,
)


class _Stream:
    """A recording in a viewer, whose layout is sent when it changes.

    Args:
        url: of the viewer.
        application: whose layout it has.
        recording_id: of the recording, which may be in the viewer already.
    """

    def __init__(self, url: str, application: str, recording_id: str) -> None:
        self.rec = rr.RecordingStream(application, recording_id=recording_id, send_properties=False)
        self.rec.connect_grpc(url)
        self._shape: object = None
        self._name = ""

    def name(self, name: str) -> None:
        """Give the recording a name to show."""
        if name != self._name:
            self.rec.send_recording_name(name)
            self._name = name

    def lay_out(self, layout: Layout) -> None:
        """Send a layout if it differs from the last one.

        A new layout brings the recording to the front, and undoes changes that the user has made.
        """
        layout.blueprint_panel = rrb.BlueprintPanel(state="expanded")  # it lists the recordings
        shape = list(_shape(layout.root_container))
        if shape != self._shape:
            self.rec.send_blueprint(layout, make_active=True)
            layout.close()
            self._shape = shape

    def close(self) -> None:
        """Send what is still to be sent, and disconnect from the viewer."""
        with freed_recordings():
            self.rec.disconnect()
            del self.rec


class RunStream(_Stream):
    """The recording of a run that is in progress or over.

    Args:
        url: of the viewer.
        figures: of the run, for its name.
        recording_id: of the recording.
    """

    def __init__(self, url: str, figures: RunFigures, recording_id: str) -> None:
        super().__init__(url, run_application(figures), recording_id)

    def send(self, part: LivePart) -> None:
        """Send the new parts of a run in progress."""
        self.lay_out(_follow_layout(run_blueprint(part.outline)))
        for key, news in part.lanes.items():
            _send_lane(self.rec, key, news)
        if part.rows.times_ns is not None:
            send_rows(self.rec, "/tasks/rows", times(part.rows.times_ns), part.rows.frame)
        send_run(self.rec, part.figures)
        self.tick(part.now_ns)

    def tick(self, now_ns: int) -> None:
        """Advance the time, up to which open executions are drawn."""
        self.rec.send_columns("/clock", [times([now_ns])], rr.AnyValues.columns(now_s=[now_ns / 1e9]))

    def send_whole(self, figures: RunFigures) -> None:
        """Send a run that is over."""
        self.lay_out(_follow_layout(run_blueprint(figures)))
        send_run(self.rec, figures)


class CampaignStream(_Stream):
    """The recording of all ended runs. What is sent replaces what was sent before.

    Args:
        url: of the viewer.
        recording_id: of the recording.
    """

    def __init__(self, url: str, recording_id: str) -> None:
        super().__init__(url, CAMPAIGN_APPLICATION, recording_id)
        self._frames: dict[tuple[str, ...], _Frame] = {}

    def send(self, figures: CampaignFigures) -> None:
        """Send the pictures and tables."""
        # without steps, because all of their pictures would be drawn and kept again whenever a run ends
        still_pages = [Page(page.name, page.plots) for page in figures.pages if page.plots]
        drawn = campaign_pictures(replace(figures, pages=tuple(still_pages)))
        frames = {path: self._frame_picture(path, picture) for path, picture in drawn.items()}
        pages = (
            Page(page.name, tuple(replace(plot, path=frames[plot.path][0]) for plot in page.plots))
            for page in still_pages
        )
        figures = replace(figures, pages=tuple(pages))
        pictures = dict(frames.values())
        self.lay_out(campaign_blueprint(figures, pictures))
        self.name(figures.name)
        send_campaign(self.rec, figures, pictures)

    def _frame_picture(self, path: tuple[str, ...], picture: Picture) -> tuple[tuple[str, ...], Picture]:
        """Return a picture with a margin to grow into, and its path, which changes when it outgrows the margin.

        Rerun 0.41 treats successive pictures of different sizes as a broken video.
        """
        height, width, _ = picture.pixels.shape
        frame = self._frames.get(path, _Frame(0, 0, 0))
        if height > frame.height or width > frame.width:
            frame = _Frame(max(_round_up(height), frame.height), max(_round_up(width), frame.width), frame.number + 1)
            self._frames[path] = frame
        margins = ((0, frame.height - height), (0, frame.width - width))
        layers = [np.pad(picture.pixels[..., i], margins, constant_values=ground) for i, ground in enumerate(CARD)]
        place = path if frame.number == 1 else (*path, f"frame {frame.number}")
        return place, replace(picture, pixels=np.stack(layers, axis=-1))


_MARGIN: Final = 120


def _round_up(length: int) -> int:
    return -(-length // _MARGIN) * _MARGIN


@dataclass(frozen=True, slots=True)
class _Frame:
    """The size of the pictures of a path, and the number of sizes so far."""

    height: int
    width: int
    number: int


def _follow_layout(layout: Layout) -> Layout:
    """Let a layout show the whole run, however long it gets, with the cursor at its end."""
    always = rr.TimeRangeBoundary.infinite()
    for view in _views(layout.root_container):
        if "TimeAxis" in view.properties:
            view.properties["TimeAxis"] = rrba.TimeAxis(view_range=rr.TimeRange(start=always, end=always))
    layout.time_panel = rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following")
    return layout


def _views(part: rrb.Container | rrb.View) -> Iterator[rrb.View]:
    if isinstance(part, rrb.View):
        yield part
    else:
        for inner in part.contents:
            yield from _views(inner)


def _shape(part: rrb.Container | rrb.View) -> Iterator[object]:
    """Yield everything that defines a layout, without the random ids of its parts."""
    if isinstance(part, rrb.View):
        yield part.class_identifier, part.origin, part.name, str(part.properties)
    else:
        yield part.kind, part.name, str(part.row_shares), str(part.column_shares)
        for inner in part.contents:
            yield from _shape(inner)
        yield "end"


def _send_lane(rec: rr.RecordingStream, key: LaneKey, news: LaneNews) -> None:
    path = lane_path(*key)
    labels = list(news.colors)
    colors = np.array([(*color, 255) for color in news.colors.values()], np.uint8)
    rec.log(path, rr.StateConfiguration(values=labels, labels=labels, colors=colors), static=True, strict=True)
    rec.send_columns(path, [times(news.times_ns)], rr.StateChange.columns(state=news.states), strict=True)
