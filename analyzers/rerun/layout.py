"""The layouts of recordings: the views of a run and of a campaign, what they show and how large they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint import archetypes as rrba
from rerun.blueprint import encodings as rrbe

from hrclog.analyzers.drawing import Picture
from hrclog.analyzers.figures.campaign import CampaignFigures
from hrclog.analyzers.figures.gantt import Gantt
from hrclog.analyzers.figures.palette import CARD
from hrclog.analyzers.figures.plot import Page, page_plots
from hrclog.analyzers.figures.run import RunFigures
from hrclog.analyzers.figures.series import Series, limits
from hrclog.analyzers.figures.table import DataTable
from hrclog.analyzers.figures.text import shorten
from hrclog.analyzers.rerun.cell import cell_view
from hrclog.analyzers.rerun.recording import RUNS, TIMELINE, Layout, entity

MAX_MARKDOWN_ROWS: Final = 100


def run_blueprint(figures: RunFigures) -> Layout:
    """Return the layout of a run's recording."""
    about = rrb.TextDocumentView(origin="/about", name="About this run")
    if not figures.tasks.frame.height and not figures.events.texts:
        return _blueprint(rrb.Tabs(about), rrb.TimePanel(state="hidden"))
    groups = dict.fromkeys(series.group for series in figures.series)
    lines: list[rrb.View | rrb.Container] = [
        _series_view(figures.gantt, name, [series for series in figures.series if series.group == name])
        for name in groups
    ]
    if len(lines) > _SERIES_ROWS:
        lines[_SERIES_ROWS - 1 :] = [rrb.Tabs(*lines[_SERIES_ROWS - 1 :])]
    below = rrb.Horizontal(rrb.Tabs(_events_view(), about), _tabs(_task_views(figures.tasks)))
    gutter = 0.0 if not lines else _GUTTER if figures.cell is None else _NARROW_GUTTER
    timeline = rrb.StateTimelineView(origin="/timeline", name="Timeline", time_view=_time_axis(figures.gantt, gutter))
    heights = [_timeline_height(figures.gantt), *[_SERIES_HEIGHT] * len(lines), _BELOW_HEIGHT]
    panel = rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="paused")
    rows = rrb.Vertical(timeline, *lines, below, row_shares=heights)
    if figures.cell is None:
        return _blueprint(rows, panel)
    return _blueprint(rrb.Horizontal(cell_view(figures.cell), rows, column_shares=_CELL_SHARES), panel)


def _tabs(views: list[rrb.View]) -> rrb.View | rrb.Container:
    return rrb.Tabs(*views) if len(views) > 1 else views[0]


_SERIES_ROWS: Final = 3
# the share of the width that the y axis of lines takes in a window of medium width; lanes leave it free to align
_GUTTER: Final = 0.011
_NARROW_GUTTER: Final = 0.017
_CELL_SHARES: Final = (2, 3)
# shares of the window's height, as px in a window of about 1000 px
_SERIES_HEIGHT: Final = 115
_BELOW_HEIGHT: Final = 220


def _timeline_height(gantt: Gantt) -> int:
    return min(max(45 + 40 * len(gantt.lanes), 130), 600)


def _series_view(gantt: Gantt, group: str, series: Sequence[Series]) -> rrb.View:
    step = all(line.step for line in series)
    low, high = limits(series)
    margin = 0.05 * (high - low)
    corner = rrb.Corner2D.RightBottom if step else rrb.Corner2D.LeftTop
    return rrb.TimeSeriesView(
        origin=entity("signals", group),
        name=shorten(group, 40).capitalize(),
        axis_x=_time_axis(gantt),
        axis_y=rrba.ScalarAxis(range=(low - margin, high + margin)) if step else None,
        plot_legend=rrb.PlotLegend(corner=corner),
    )


def _events_view() -> rrb.View:
    columns = rrba.TextLogColumns(
        timeline_columns=[rrbe.TimelineColumn(timeline=TIMELINE)],
        text_log_columns=[rrbe.TextLogColumn(kind) for kind in ("LogLevel", "Body")],
    )
    return rrb.TextLogView(origin="/events", name="Events", columns=columns)


def _task_views(table: DataTable) -> list[rrb.View]:
    query = rrba.DataframeQuery(timeline=TIMELINE)
    rows = rrb.DataframeView(origin="/tasks/rows", name="Data frame", query=query)
    text = rrb.TextDocumentView(origin="/tasks/text", name=table.title)
    if not table.frame.height:
        return [text]
    return [text, rows] if table.frame.height <= MAX_MARKDOWN_ROWS else [rows]


def _time_axis(gantt: Gantt, gutter: float = 0.0) -> rrba.TimeAxis:
    """Return the time in view. The lanes' view leaves a gutter where the lines' views have their y axis."""
    length = gantt.end_ns - gantt.start_ns
    margin = max(length // 100, 1)
    bound = rr.TimeRangeBoundary.absolute
    # a linked axis would ignore the range and open at +-30 s
    return rrba.TimeAxis(
        view_range=rr.TimeRange(
            start=bound(seq=gantt.start_ns - margin - round(gutter * length)), end=bound(seq=gantt.end_ns + margin)
        )
    )


def campaign_blueprint(figures: CampaignFigures, pictures: Mapping[tuple[str, ...], Picture]) -> Layout:
    """Return the layout of a campaign's recording. The keys of `pictures` are the paths of the plots."""
    pages = [_page(page, pictures) for page in figures.pages]
    tables = rrb.Tabs(*[_table_view(table) for table in figures.tables], name="Tables")
    about = rrb.TextDocumentView(origin="/about", name="About")
    steps = any(page.steps for page in figures.pages)
    runs_panel = rrb.TimePanel(state="collapsed", timeline=RUNS, play_state="paused")
    panel = runs_panel if steps else rrb.TimePanel(state="hidden")
    return _blueprint(rrb.Tabs(*pages, tables, about, active_tab=0), panel)


def _page(page: Page, pictures: Mapping[tuple[str, ...], Picture]) -> rrb.Container:
    views = [_picture_view(plot.path, plot.title, pictures) for plot in page.plots]
    views += [_picture_view(steps.plots[-1].path, steps.title, pictures) for steps in page.steps]
    if len(views) > 2:
        return rrb.Tabs(*views, name=page.name)
    shapes = [pictures[plot.path].pixels.shape for plot in page_plots(page)]
    wide = all(width > _WIDE * height for height, width, _ in shapes)
    return rrb.Vertical(*views, name=page.name) if wide else rrb.Horizontal(*views, name=page.name)


_WIDE: Final = 1.6
"""Wider pictures (width over height) are placed above each other rather than side by side."""


def _picture_view(path: tuple[str, ...], name: str, pictures: Mapping[tuple[str, ...], Picture]) -> rrb.View:
    height, width = pictures[path].pixels.shape[:2]
    bounds = rrb.VisualBounds2D(x_range=(0, width), y_range=(0, height))
    origin = f"{entity(*path)}/picture"
    return rrb.Spatial2DView(origin=origin, name=shorten(name, 60), background=CARD, visual_bounds=bounds)


def _table_view(table: DataTable) -> rrb.View:
    if table.frame.height <= MAX_MARKDOWN_ROWS:
        return rrb.TextDocumentView(origin=f"/tables/{table.name}/text", name=table.title)
    query = rrba.DataframeQuery(timeline="row")
    return rrb.DataframeView(origin=f"/tables/{table.name}/rows", name=table.title, query=query)


def _blueprint(root: rrb.Container, panel: rrb.TimePanel) -> Layout:
    sides = rrb.BlueprintPanel(state="collapsed"), rrb.SelectionPanel(state="collapsed")
    return Layout(root, *sides, panel, auto_views=False, auto_layout=False)
