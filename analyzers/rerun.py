"""The Rerun back end: recordings that open laid out. With the other `rerun_*` modules all that knows Rerun.

Entities of a run are under /timeline (a lane per agent), /signals, /events, /tasks, /cell and /about, on the timeline
`run_time` (since the run's first event); those of a campaign under /synergy, /coefficients, /overlap, /durations,
/tables and /about, mostly static. Everything that happens in time is sent as columns, never as one call per event.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
import pyarrow as pa
import rerun as rr

from hrclog.analyzers.figures.about import about_campaign, about_run
from hrclog.analyzers.figures.boxplot_canvas import boxplot_canvas
from hrclog.analyzers.figures.campaign import CampaignFigures
from hrclog.analyzers.figures.canvas import Canvas, Dot, Rect, Stroke
from hrclog.analyzers.figures.coefficients_canvas import coefficients_canvas
from hrclog.analyzers.figures.gantt import Lane, state_changes
from hrclog.analyzers.figures.heatmap import Heatmap
from hrclog.analyzers.figures.palette import Color
from hrclog.analyzers.figures.raster import draw_heatmap
from hrclog.analyzers.figures.run import RunFigures
from hrclog.analyzers.figures.series import Series
from hrclog.analyzers.figures.table import DataTable, markdown
from hrclog.analyzers.figures.text import printable, shorten
from hrclog.analyzers.rerun_cell import send_cell
from hrclog.analyzers.rerun_layout import MAX_MARKDOWN_ROWS, campaign_blueprint, run_blueprint
from hrclog.analyzers.rerun_recording import entity, freed_recordings, recording, times

RUN_APPLICATION: Final = "hrclog"
CAMPAIGN_APPLICATION: Final = "hrclog-campaign"
"""A blueprint belongs to an application: with one name the campaign's would be laid over every run opened beside it."""


@freed_recordings()
def save_run(figures: RunFigures, path: Path | str) -> None:
    """Write the recording of one run.

    Raises:
        OutputError: the file cannot be written.
    """
    with recording(RUN_APPLICATION, figures.run_id, figures.name, path, run_blueprint(figures)) as rec:
        rec.send_recording_start_time_nanos(figures.origin_ns)
        rec.send_property("run", _properties(figures.facts))
        for lane in figures.gantt.lanes:
            _send_lane(rec, lane)
        for series in figures.series:
            _send_series(rec, series)
        _send_events(rec, figures)
        if figures.tasks.times_ns is not None:
            _send_rows(rec, "/tasks/rows", times(figures.tasks.times_ns), figures.tasks.frame)
        _send_text(rec, "/tasks/text", markdown(figures.tasks, MAX_MARKDOWN_ROWS))
        left_out = send_cell(rec, figures.cell) if figures.cell is not None else []
        _send_text(rec, "/about", about_run(figures, left_out))


@freed_recordings()
def save_campaign(figures: CampaignFigures, path: Path | str) -> None:
    """Write the recording of a campaign.

    Raises:
        OutputError: the file cannot be written.
    """
    pictures = _pictures(figures)
    blueprint = campaign_blueprint(figures, pictures)
    with recording(CAMPAIGN_APPLICATION, figures.campaign_id, figures.name, path, blueprint) as rec:
        rec.send_property("campaign", _properties(figures.facts))
        for picture, canvas in pictures.items():
            _send_canvas(rec, f"{picture}/picture", canvas)
        for kind, heatmap in _heatmaps(figures):
            tensor = rr.Tensor(heatmap.values, dim_names=("task", "other task"))
            rec.log(f"{_pair_path(kind, heatmap.agents)}/values", tensor, static=True, strict=True)
        for table in figures.tables:
            _send_table(rec, table)
        _send_text(rec, "/about", about_campaign(figures))


def _pictures(figures: CampaignFigures) -> dict[str, Canvas]:
    heatmaps = {
        _pair_path(kind, one.agents): Canvas(_while(one.agents), draw_heatmap(one)) for kind, one in _heatmaps(figures)
    }
    coefficients = {_pair_path("coefficients", one.agents): coefficients_canvas(one) for one in figures.coefficients}
    durations = {entity("durations", one.agent or "all"): boxplot_canvas(one) for one in figures.durations}
    return heatmaps | coefficients | durations


def _while(agents: tuple[str, str]) -> str:
    return f"{shorten(agents[0], 28)} while {shorten(agents[1], 28)} works"


# entities


def _lane_path(lane: Lane) -> str:
    return entity("timeline", lane.agent, f"{lane.kind}_{lane.number + 1}" if lane.number else lane.kind)


def _pair_path(kind: str, agents: tuple[str, str]) -> str:
    return entity(*kind.split("/"), *agents)


def _heatmaps(figures: CampaignFigures) -> list[tuple[str, Heatmap]]:
    pairs = [(f"overlap/{kind}", one) for two in figures.overlaps for kind, one in zip(_OVERLAPS, two, strict=True)]
    return [("synergy", heatmap) for heatmap in figures.synergies] + pairs


_OVERLAPS: Final = ("seconds", "ratio")


# columns


def _send_lane(rec: rr.RecordingStream, lane: Lane) -> None:
    instants, states = state_changes(lane)
    if not states:
        return
    path = _lane_path(lane)
    colors = {bar.label: bar.color for bar in lane.bars}
    style = rr.StateConfiguration(values=list(colors), labels=list(colors), colors=_rgba(colors.values()))
    rec.log(path, style, static=True, strict=True)
    rec.send_columns(path, [times(instants)], rr.StateChange.columns(state=states), strict=True)


def _send_series(rec: rr.RecordingStream, series: Series) -> None:
    path = entity("signals", series.group, series.name)
    mode = rr.components.InterpolationMode.StepAfter if series.step else rr.components.InterpolationMode.Linear
    # what is held until the next sample must not be averaged with it: the mean would be held too
    whole = rr.components.AggregationPolicy.Off if series.step else None
    style = rr.SeriesLines(names=[shorten(series.name, 60)], interpolation_mode=mode, aggregation_policy=whole)
    rec.log(path, style, static=True, strict=True)
    rec.send_columns(path, [times(series.times_ns)], rr.Scalars.columns(scalars=series.values), strict=True)


def _send_events(rec: rr.RecordingStream, figures: RunFigures) -> None:
    lines = figures.events
    if lines.texts:
        columns = rr.TextLog.columns(text=lines.texts, level=lines.levels)
        rec.send_columns("/events", [times(lines.times_ns)], columns, strict=True)


def _send_table(rec: rr.RecordingStream, table: DataTable) -> None:
    _send_rows(rec, f"/tables/{table.name}/rows", rr.TimeColumn("row", sequence=range(table.frame.height)), table.frame)
    _send_text(rec, f"/tables/{table.name}/text", markdown(table, MAX_MARKDOWN_ROWS))


def _send_rows(rec: rr.RecordingStream, path: str, index: rr.TimeColumn, frame: pl.DataFrame) -> None:
    if not frame.height:
        return
    # arrow arrays pass by Rerun's process-wide table of types, in which equal column names of two tables would clash
    columns = {name: _arrow(frame[name]) for name in frame.columns}
    rec.send_columns(path, [index], rr.AnyValues.columns(**columns), strict=True)


def _properties(facts: Sequence[tuple[str, str | float]]) -> rr.AnyValues:
    return rr.AnyValues(**{name: _arrow(pl.Series([value])) for name, value in facts})


def _arrow(column: pl.Series) -> pa.Array:
    return column.to_arrow().cast(pa.string()) if column.dtype == pl.String else column.to_arrow()


def _send_canvas(rec: rr.RecordingStream, path: str, canvas: Canvas) -> None:
    rec.log(path, rr.Image(canvas.backdrop, magnification_filter="Linear"), static=True, strict=True)
    if canvas.rects:
        rects = canvas.rects
        lows, highs = np.array([rect.low for rect in rects]), np.array([rect.high for rect in rects])
        shapes = rr.Boxes2D(mins=lows, sizes=highs - lows, radii=1.0, **_looks(rects))
        rec.log(f"{path}/boxes", shapes, static=True, strict=True)
    if canvas.strokes:
        strips = [stroke.points for stroke in canvas.strokes]
        radii = [stroke.width / 2 for stroke in canvas.strokes]
        rec.log(
            f"{path}/lines", rr.LineStrips2D(strips, radii=radii, **_looks(canvas.strokes)), static=True, strict=True
        )
    if canvas.dots:
        centers, radii = [dot.center for dot in canvas.dots], [dot.radius for dot in canvas.dots]
        rec.log(f"{path}/points", rr.Points2D(centers, radii=radii, **_looks(canvas.dots)), static=True, strict=True)


def _send_text(rec: rr.RecordingStream, path: str, text: str) -> None:
    rec.log(path, rr.TextDocument(text, media_type="text/markdown"), static=True, strict=True)


def _rgba(colors: Iterable[Color]) -> np.typing.NDArray[np.uint8]:
    return np.array([(*color, 255) for color in colors], np.uint8)


def _looks(shapes: Sequence[Rect] | Sequence[Stroke] | Sequence[Dot]) -> dict[str, Any]:
    """Return colours and labels of shapes; the labels show when a shape is pointed at."""
    labels = [printable(shape.label) for shape in shapes]
    return {"colors": _rgba(shape.color for shape in shapes), "labels": labels, "show_labels": False}
