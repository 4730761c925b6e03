"""A report as one self-contained HTML file."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from hrclog.analyzers.figures.palette import DARK, LIGHT, Color, Role
from hrclog.analyzers.figures.plot import Plot
from hrclog.analyzers.report.document import Figure, Report

_HERE: Final = Path(__file__).parent
_WIDTH: Final = re.compile(r"<svg[^>]*?\swidth=\"([0-9.]+)(pt|px)?\"")
_VIEW_BOX: Final = re.compile(r"<svg[^>]*?\sviewBox=\"\S+ \S+ ([0-9.]+) ")
_PART: Final = re.compile(r"""(?:\bid="|href="#|url\(#)(?=p[0-9a-f]{10}-\d+["')])""")
_BREAK: Final = re.compile(r"(?<=_)(?=[^_]{3})")
_PX_PER_PT: Final = 96 / 72


@dataclass(frozen=True, slots=True)
class _Picture:
    """An <svg> element, its width in px, its title, the number of runs it shows, and what is not drawn."""

    svg: Markup
    width: int
    title: str
    number: int
    notes: tuple[str, ...]


def render(report: Report, draw: Callable[[Plot], str]) -> str:
    """Return a report as HTML.

    Args:
        report: what it says.
        draw: makes an <svg> element of a plot.
    """
    script = _asset("report.js")
    return (
        _environment(draw)
        .get_template("report.html.j2")
        .render(
            report=report,
            style=Markup(f"{_theme()}\n{_asset('report.css')}"),  # noqa: S704 - our own file
            script=Markup(script),  # noqa: S704 - our own file
            script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        )
    )


def _environment(draw: Callable[[Plot], str]) -> Environment:
    environment = Environment(
        loader=FileSystemLoader(_HERE, encoding="utf-8"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["drawn"] = partial(_draw_figure, draw)
    environment.filters["breakable"] = _make_breakable
    return environment


def _make_breakable(text: str) -> Markup:
    """Return a text whose lines may break within a name, after an underscore."""
    return Markup("<wbr>").join(_BREAK.split(text))


def _draw_figure(draw: Callable[[Plot], str], figure: Figure) -> tuple[_Picture, ...]:
    """Return the pictures of a figure: its stages, or a single one."""
    stages = figure.stages or ((0, figure.plot),)
    return tuple(
        _picture(_prefix_part_names(draw(plot), f"f{figure.number}-{place}"), plot, number)
        for place, (number, plot) in enumerate(stages)
    )


def _prefix_part_names(svg: str, prefix: str) -> str:
    """Return a picture whose part names are unique, even if the page has the same picture twice."""
    return _PART.sub(rf"\g<0>{prefix}-", svg)


def _picture(svg: str, plot: Plot, number: int) -> _Picture:
    element = Markup(svg)  # noqa: S704 - the back end escapes what logs say
    return _Picture(element, round(_width(svg)), plot.title, number, plot.notes)


def _width(svg: str) -> float:
    if match := _WIDTH.match(svg):
        return float(match[1]) * (_PX_PER_PT if match[2] == "pt" else 1)
    match = _VIEW_BOX.match(svg)
    return float(match[1]) if match else 0.0


def _asset(name: str) -> str:
    return (_HERE / name).read_text(encoding="utf-8")


def _theme() -> str:
    """Return the colours of both themes as CSS variables; paper is light."""
    return (
        f":root {{ color-scheme: light dark; {_variables(LIGHT)} }}\n"
        f"@media screen and (prefers-color-scheme: dark) {{ :root {{ {_variables(DARK)} }} }}"
    )


def _variables(theme: Mapping[Role, Color]) -> str:
    return " ".join(f"--{role}: rgb({red}, {green}, {blue});" for role, (red, green, blue) in theme.items())
