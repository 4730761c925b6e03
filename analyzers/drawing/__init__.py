"""Draw plots: pixels for a recording, SVG for a page, files for a paper."""

from __future__ import annotations

import logging
import math
import threading
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.transforms import Affine2D

from hrclog.analyzers.drawing.hover import hover
from hrclog.analyzers.drawing.layout import Layout, lay_out
from hrclog.analyzers.drawing.marks import Inks, Pen
from hrclog.analyzers.drawing.scale import Scale
from hrclog.analyzers.drawing.svg import finished, stand_ins
from hrclog.analyzers.figures.palette import DARK, LIGHT, Color, Role
from hrclog.analyzers.figures.plot import Plot, Point
from hrclog.arrays import ByteArray
from hrclog.files import write_output

_FILE_DPI: Final = 96  # px per inch in files
_PAPER_DPI: Final = 300
_SVG_DPI: Final = 72  # matplotlib's unit there, which becomes a px

_LOCK: Final = threading.Lock()  # settings of matplotlib are shared by all threads


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A drawn plot.

    Attributes:
        pixels: shape (height, width, 3), RGB.
        area: left, top, right, bottom of the area between the axes, in px from the upper left corner.
    """

    pixels: ByteArray
    area: tuple[float, float, float, float]

    def at(self, plot: Plot, point: Point) -> tuple[float, float]:
        """Return the px of a point of the plot in this picture."""
        left, top, right, bottom = self.area
        return float(Scale(plot.x, left, right).at(point[0])), float(Scale(plot.y, bottom, top).at(point[1]))


def pixels(plot: Plot, theme: Mapping[Role, Color] = DARK) -> Picture:
    """Return the picture of a plot with its title, reading and notes."""
    with _settings():
        layout = lay_out(plot, captions=True)
        canvas = FigureCanvasAgg(_figure(layout, _inks(theme), _FILE_DPI, theme["card"]))
        canvas.draw()  # type: ignore[no-untyped-call]  # its stub is bare
        rgba = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]  # its stub is bare
        return Picture(rgba[:, :, :3].copy(), layout.frame.area)


def svg(plot: Plot) -> str:
    """Return an <svg> element for HTML: without captions, and with a CSS variable for each role of the theme."""
    with _settings():
        layout = lay_out(plot, captions=False)
        theme = stand_ins(plot)
        variables = {color: f"var(--{role})" for role, color in theme.items()}
        return finished(_svg(layout, theme), layout, variables, hover(layout))


def save_png(plot: Plot, path: Path) -> None:
    """Write a plot for a paper: light theme, 300 dots per inch, no captions.

    Raises:
        OutputError: the file cannot be written.
    """
    with _settings():
        figure = _figure(lay_out(plot, captions=False), _inks(LIGHT), _FILE_DPI, LIGHT["card"])
        target = BytesIO()
        figure.savefig(target, format="png", dpi=_PAPER_DPI, metadata={"Software": None})
    write_output(path, target.getvalue())


def save_svg(plot: Plot, path: Path) -> None:
    """Write a plot for a paper: light theme, no captions, text as text.

    Raises:
        OutputError: the file cannot be written.
    """
    with _settings():
        layout = lay_out(plot, captions=False)
        element = finished(_svg(layout, LIGHT), layout, {})
    write_output(path, f"{element}\n".encode())


def save_pdf(plots: Sequence[Plot], path: Path) -> None:
    """Write plots (at least one) for a paper: light theme, one page per plot, as large as the picture with captions.

    Raises:
        OutputError: the file cannot be written.
    """
    from matplotlib.backends.backend_pdf import PdfPages

    target = BytesIO()
    with _settings(), PdfPages(target, metadata={"CreationDate": None, "Creator": None, "Producer": None}) as pages:
        for plot in plots:
            pages.savefig(_figure(lay_out(plot, captions=True), _inks(LIGHT), _FILE_DPI, LIGHT["card"]))
    write_output(path, target.getvalue())


def _svg(layout: Layout, theme: Mapping[Role, Color]) -> str:
    target = BytesIO()
    figure = _figure(layout, _inks(theme), _SVG_DPI, None)
    FigureCanvasSVG(figure).print_svg(target, metadata={"Date": None})  # type: ignore[no-untyped-call]  # its stub is bare
    return target.getvalue().decode()


def _figure(layout: Layout, inks: Inks, per_inch: float, ground: Color | None) -> Figure:
    """Return a figure in which a px is 1 / `per_inch` of an inch."""
    # matplotlib rounds down: a size in inches just below a whole number of px would lose a px
    size = (math.nextafter(layout.width / per_inch, math.inf), math.nextafter(layout.height / per_inch, math.inf))
    figure = Figure(figsize=size, dpi=per_inch, frameon=ground is not None)
    if ground is not None:
        figure.set_facecolor(_rgb(ground))
    down = Affine2D().scale(1 / per_inch, -1 / per_inch).translate(0, layout.height / per_inch)
    pen = Pen(inks, down + figure.dpi_scale_trans, 72 / per_inch)
    for height, artist in enumerate(pen.artists(layout)):
        artist.set_zorder(height)
        figure.add_artist(artist)
    return figure


def _inks(theme: Mapping[Role, Color]) -> Inks:
    return lambda paint: _rgb(theme[paint] if isinstance(paint, str) else paint)


def _rgb(color: Color) -> tuple[float, float, float]:
    return color[0] / 255, color[1] / 255, color[2] / 255


@contextmanager
def _settings() -> Iterator[None]:
    """Draw with the same settings everywhere, and restore those of the user."""
    fonts = logging.getLogger("matplotlib.font_manager")
    level = fonts.level
    with _LOCK, mpl.rc_context(), warnings.catch_warnings():
        mpl.rcdefaults()
        mpl.rc("pdf", fonttype=42)
        mpl.rc("svg", fonttype="none", hashsalt="hrclog")
        mpl.rc("text", hinting="no_hinting")  # widths are the same at each size
        # a character that no font has is drawn as a box; one without a bold form is drawn in plain letters
        warnings.filterwarnings("ignore", message="Glyph ", category=UserWarning)
        fonts.setLevel(logging.ERROR)
        try:
            yield
        finally:
            fonts.setLevel(level)
