"""Turn matplotlib's SVG into an element for a page that has several of them."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping
from itertools import count
from typing import Final
from xml.etree.ElementTree import Element, fromstring, tostring

from hrclog.analyzers.drawing.fonts import legal
from hrclog.analyzers.drawing.layout import Layout
from hrclog.analyzers.drawing.marks import BARS
from hrclog.analyzers.figures.palette import LIGHT, Color, Paint, Role
from hrclog.analyzers.figures.plot import Plot

_SPACE: Final = "http://www.w3.org/2000/svg"
_LINK: Final = "{http://www.w3.org/1999/xlink}href"
# everything is placed by the letter widths of DejaVu Sans, and those of Verdana are equal
_FONTS: Final = "'DejaVu Sans', Verdana, 'Noto Sans', 'Noto Sans CJK SC', 'Microsoft YaHei', sans-serif"
_REFERENCE: Final = re.compile(r"url\(#([^)]+)\)")
_NUMBER: Final = re.compile(r"-?\d+\.\d+")
_BESIDE_LETTER: Final = re.compile(r"\s*([A-Za-z])\s*")


def stand_ins(plot: Plot) -> dict[Role, Color]:
    """Return for each role of a theme a colour that the plot does not use."""
    used_colors = set(_paints(plot))
    free = (color for color in ((1, 2, blue) for blue in count()) if color not in used_colors)
    return dict(zip(LIGHT, free, strict=False))


def finished(source: str, layout: Layout, variables: Mapping[Color, str], hover: Element | None = None) -> str:
    """Return an SVG element for a page, made from matplotlib's output.

    Args:
        source: the SVG that matplotlib wrote; its points are the px of the layout.
        layout: the layout that it drew.
        variables: texts to write instead of colours.
        hover: an element to put on top.
    """
    root = fromstring(source)  # noqa: S314 - matplotlib wrote it
    names = _names(root, hashlib.sha256(source.encode()).hexdigest()[:10])
    css_colors = {"#{:02x}{:02x}{:02x}".format(*color): variable for color, variable in variables.items()}
    for element in root.iter():
        _tidy(element, names, css_colors)
    title = Element("title")
    title.text = legal(layout.frame.plot.title)
    children = [child for child in root if child.tag == "g" or child.find("clipPath") is not None]
    picture = Element("svg", _head(layout))
    picture.extend([title, *children, *([] if hover is None else [hover])])
    return tostring(picture, encoding="unicode")


def _head(layout: Layout) -> dict[str, str]:
    width, height = layout.width, layout.height
    return {
        "xmlns": _SPACE,
        "width": str(width),
        "height": str(height),
        "viewBox": f"0 0 {width} {height}",
        "role": "img",
        "stroke-linejoin": "round",
        "font-family": _FONTS,
    }


def _names(root: Element, salt: str) -> dict[str, str]:
    """Return new, unique names for the parts that others refer to."""
    references = [
        reference for element in root.iter() for value in element.attrib.values() for reference in _references(value)
    ]
    return {name: f"p{salt}-{index}" for index, name in enumerate(dict.fromkeys(references))}


def _references(value: str) -> Iterator[str]:
    if value.startswith("#"):
        yield value[1:]
    yield from _REFERENCE.findall(value)


def _tidy(element: Element, names: Mapping[str, str], css_colors: Mapping[str, str]) -> None:
    """Remove the namespace, the blanks, the unused names and the needless digits from an element."""
    element.tag = element.tag.removeprefix(f"{{{_SPACE}}}")
    element.tail = None
    if element.text is not None and not element.text.strip():
        element.text = None
    attributes = element.attrib
    name = attributes.pop("id", "")
    if name in names:
        attributes["id"] = names[name]
    if name == BARS:
        attributes["shape-rendering"] = "crispEdges"  # no seam between neighbours
    if _LINK in attributes:
        attributes["href"] = f"#{names[attributes.pop(_LINK)[1:]]}"
    if "clip-path" in attributes:
        attributes["clip-path"] = _REFERENCE.sub(lambda match: f"url(#{names[match[1]]})", attributes["clip-path"])
    if "d" in attributes:
        attributes["d"] = _BESIDE_LETTER.sub(r"\1", _NUMBER.sub(_shorten_number, attributes["d"])).strip()
    if "style" in attributes:
        attributes["style"] = _style(attributes["style"], css_colors)


def _shorten_number(number: re.Match[str]) -> str:
    return f"{float(number[0]):.2f}".rstrip("0").rstrip(".")


def _style(style: str, css_colors: Mapping[str, str]) -> str:
    pairs = (pair.split(": ", 1) for pair in style.split("; ") if ": " in pair)
    return ";".join(f"{name}:{css_colors.get(value, value)}" for name, value in pairs if name != "font-family")


def _paints(plot: Plot) -> Iterator[Paint]:
    for marks in (plot.rects, plot.bands, plot.strokes, plot.dots, plot.texts, plot.keys):
        yield from (mark.paint for mark in marks)
    for rimmed in (plot.dots, plot.keys):
        yield from (mark.rim for mark in rimmed if mark.rim is not None)
    if plot.color_bar is not None:
        yield from plot.color_bar.paints
