"""The Rerun back end: recordings that open with a layout.

Entities of a run are under /timeline (a lane per agent), /signals, /events, /tasks, /cell and /about, on the timeline
`run_time` (since the run's first event). Entities of a campaign are under /synergy, /coefficients, /overlap,
/durations, /tables and /about, and mostly static. Everything over time is sent as columns, never as one call per event.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
import pyarrow as pa
import rerun as rr
from PIL import Image

from hrclog.analyzers.drawing import Picture, pixels
from hrclog.analyzers.figures.about import about_campaign, about_run
from hrclog.analyzers.figures.campaign import CampaignFigures
from hrclog.analyzers.figures.gantt import Lane, state_changes
from hrclog.analyzers.figures.palette import CARD, DARK, Color, Paint
from hrclog.analyzers.figures.plot import Dot, Plot, Point, Rect, Steps, Stroke, page_plots
from hrclog.analyzers.figures.run import RunFigures
from hrclog.analyzers.figures.series import Series
from hrclog.analyzers.figures.table import DataTable, markdown
from hrclog.analyzers.figures.text import printable, shorten
from hrclog.analyzers.rerun.cell import send_cell
from hrclog.analyzers.rerun.layout import MAX_MARKDOWN_ROWS, campaign_blueprint, run_blueprint
from hrclog.analyzers.rerun.recording import RUNS, entity, freed_recordings, recording, times
from hrclog.arrays import ByteArray, FloatArray

APPLICATION: Final = "hrclog"
CAMPAIGN_APPLICATION: Final = "hrclog-campaign"


@freed_recordings()
def save_run(figures: RunFigures, path: Path | str) -> None:
    """Write the recording of one run.

    Raises:
        OutputError: the file cannot be written.
    """
    with recording(run_application(figures), figures.run_id, figures.label, path, run_blueprint(figures)) as rec:
        send_run(rec, figures)


def run_application(figures: RunFigures) -> str:
    """Return the application of a run's recording. Each has its own, because a layout belongs to an application.

    Rerun 0.41 accepts only some characters in the name of an application, and warns the user of others.
    """
    name = _UNFIT.sub("-", figures.name)[:_LONGEST_NAME]
    digest = hashlib.sha256(figures.name.encode("utf-8", "surrogatepass")).hexdigest()[:8]
    return f"{APPLICATION} {name}" if name == figures.name else f"{APPLICATION} {name} {digest}"


_UNFIT: Final = re.compile(r"[^A-Za-z0-9_ :-]+")
_LONGEST_NAME: Final = 80


def send_run(rec: rr.RecordingStream, figures: RunFigures) -> None:
    """Send everything of a run to its recording."""
    rec.send_recording_start_time_nanos(figures.origin_ns)
    rec.send_property("run", _properties(figures.facts))
    for lane in figures.gantt.lanes:
        _send_lane(rec, lane)
    for series in figures.series:
        _send_series(rec, series)
    _send_events(rec, figures)
    if figures.tasks.times_ns is not None:
        send_rows(rec, "/tasks/rows", times(figures.tasks.times_ns), figures.tasks.frame)
    _send_text(rec, "/tasks/text", markdown(figures.tasks, MAX_MARKDOWN_ROWS))
    left_out = send_cell(rec, figures.cell) if figures.cell is not None else []
    _send_text(rec, "/about", about_run(figures, left_out))


@freed_recordings()
def save_campaign(figures: CampaignFigures, path: Path | str) -> None:
    """Write the recording of a campaign.

    Raises:
        OutputError: the file cannot be written.
    """
    pictures = campaign_pictures(figures)
    layout = campaign_blueprint(figures, pictures)
    with recording(CAMPAIGN_APPLICATION, figures.campaign_id, figures.name, path, layout) as rec:
        send_campaign(rec, figures, pictures)


Pictures = Mapping[tuple[str, ...], Picture]
"""Drawn plots by their path; of steps, only the last plot."""


def campaign_pictures(figures: CampaignFigures) -> Pictures:
    """Draw every plot of a campaign once."""
    return {plot.path: pixels(plot) for page in figures.pages for plot in page_plots(page)}


def send_campaign(rec: rr.RecordingStream, figures: CampaignFigures, pictures: Pictures) -> None:
    """Send everything of a campaign to its recording."""
    rec.send_property("campaign", _properties(figures.facts))
    for page in figures.pages:
        for plot in page.plots:
            _send_plot(rec, plot, pictures[plot.path])
        for steps in page.steps:
            _send_steps(rec, steps, pictures[steps.plots[-1].path])
    for matrix in figures.matrices:
        tensor = rr.Tensor(matrix.heatmap.values, dim_names=("task", "other task"))
        rec.log(f"{entity(*matrix.path)}/values", tensor, static=True, strict=True)
    for table in figures.tables:
        _send_table(rec, table)
    _send_text(rec, "/about", about_campaign(figures))


def lane_path(agent: str, kind: str, number: int) -> str:
    """Return the entity of a lane of a run."""
    return entity("timeline", agent, f"{kind}_{number + 1}" if number else kind)


# columns


def _send_lane(rec: rr.RecordingStream, lane: Lane) -> None:
    instants, states = state_changes(lane)
    if not states:
        return
    path = lane_path(lane.agent, lane.kind, lane.number)
    colors = {bar.label: bar.color for bar in lane.bars}
    style = rr.StateConfiguration(values=list(colors), labels=list(colors), colors=_rgba(colors.values()))
    rec.log(path, style, static=True, strict=True)
    rec.send_columns(path, [times(instants)], rr.StateChange.columns(state=states), strict=True)


def _send_series(rec: rr.RecordingStream, series: Series) -> None:
    path = entity("signals", series.group, series.name)
    mode = rr.components.InterpolationMode.StepAfter if series.step else rr.components.InterpolationMode.Linear
    # a value held until the next sample must not be averaged with it, because the mean would be held too
    aggregation = rr.components.AggregationPolicy.Off if series.step else None
    style = rr.SeriesLines(names=[shorten(series.name, 60)], interpolation_mode=mode, aggregation_policy=aggregation)
    rec.log(path, style, static=True, strict=True)
    rec.send_columns(path, [times(series.times_ns)], rr.Scalars.columns(scalars=series.values), strict=True)


def _send_events(rec: rr.RecordingStream, figures: RunFigures) -> None:
    lines = figures.events
    if lines.texts:
        columns = rr.TextLog.columns(text=lines.texts, level=lines.levels)
        rec.send_columns("/events", [times(lines.times_ns)], columns, strict=True)


def _send_table(rec: rr.RecordingStream, table: DataTable) -> None:
    send_rows(rec, f"/tables/{table.name}/rows", rr.TimeColumn("row", sequence=range(table.frame.height)), table.frame)
    _send_text(rec, f"/tables/{table.name}/text", markdown(table, MAX_MARKDOWN_ROWS))


def send_rows(rec: rr.RecordingStream, path: str, index: rr.TimeColumn, frame: pl.DataFrame) -> None:
    """Send the rows of a frame, each at its place on a timeline."""
    if not frame.height:
        return
    # arrow arrays bypass Rerun's process-wide table of types, in which equal column names of two tables would clash
    columns = {name: _arrow(frame[name]) for name in frame.columns}
    rec.send_columns(path, [index], rr.AnyValues.columns(**columns), strict=True)


def _properties(facts: Sequence[tuple[str, str | float]]) -> rr.AnyValues:
    return rr.AnyValues(**{name: _arrow(pl.Series([value])) for name, value in facts})


def _arrow(column: pl.Series) -> pa.Array:
    return column.to_arrow().cast(pa.string()) if column.dtype == pl.String else column.to_arrow()


def _send_plot(rec: rr.RecordingStream, plot: Plot, picture: Picture) -> None:
    path = f"{entity(*plot.path)}/picture"
    rec.log(path, _image(picture.pixels), static=True, strict=True)

    def at(points: Iterable[Point]) -> FloatArray:
        return np.array([picture.at(plot, point) for point in points])

    if rects := [rect for rect in plot.rects if rect.label]:
        first_corners, second_corners = at(rect.low for rect in rects), at(rect.high for rect in rects)
        lows, highs = np.minimum(first_corners, second_corners), np.maximum(first_corners, second_corners)
        shapes = rr.Boxes2D(mins=lows, sizes=highs - lows, radii=0.5, **_shape_style(rects))
        rec.log(f"{path}/boxes", shapes, static=True, strict=True)
    if strokes := [stroke for stroke in plot.strokes if stroke.label and not stroke.step]:
        strips = [at(stroke.points) for stroke in strokes]
        radii = [stroke.width / 2 for stroke in strokes]
        lines = rr.LineStrips2D(strips, radii=radii, **_shape_style(strokes))
        rec.log(f"{path}/lines", lines, static=True, strict=True)
    if dots := [dot for dot in plot.dots if dot.label]:
        radii = [dot.radius for dot in dots]
        points = rr.Points2D(at(dot.at for dot in dots), radii=radii, **_shape_style(dots))
        rec.log(f"{path}/points", points, static=True, strict=True)


def _send_steps(rec: rr.RecordingStream, steps: Steps, last: Picture) -> None:
    pictures = [*(pixels(plot).pixels for plot in steps.plots[:-1]), last.pixels]
    height, width = (max(image.shape[side] for image in pictures) for side in (0, 1))
    path = f"{entity(*steps.plots[-1].path)}/picture"
    for number, image in zip(steps.numbers, pictures, strict=True):
        rec.set_time(RUNS, sequence=number)
        # Rerun treats encoded images over time as a video, whose size must not change
        rec.log(path, _image(_pad_image(image, height, width)), strict=True)
    rec.reset_time()


def _pad_image(image: ByteArray, height: int, width: int) -> ByteArray:
    card = np.full((height, width, 3), CARD, np.uint8)
    card[: image.shape[0], : image.shape[1]] = image
    return card


def _image(image: ByteArray) -> rr.EncodedImage:
    target = BytesIO()
    Image.fromarray(image).save(target, "png", compress_level=1)  # more effort saves next to nothing
    return rr.EncodedImage(contents=target.getvalue(), media_type="image/png", magnification_filter="Linear")


def _send_text(rec: rr.RecordingStream, path: str, text: str) -> None:
    rec.log(path, rr.TextDocument(text, media_type="text/markdown"), static=True, strict=True)


def _rgba(paints: Iterable[Paint]) -> ByteArray:
    return np.array([(*_color(paint), 255) for paint in paints], np.uint8)


def _color(paint: Paint) -> Color:
    return DARK[paint] if isinstance(paint, str) else paint


def _shape_style(shapes: Sequence[Rect] | Sequence[Stroke] | Sequence[Dot]) -> dict[str, Any]:
    """Return the colours and labels of shapes. A label shows when the pointer is on its shape."""
    labels = [printable(shape.label) for shape in shapes]
    return {"colors": _rgba(shape.paint for shape in shapes), "labels": labels, "show_labels": False}
