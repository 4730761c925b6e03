"""Labels of marks, which the browser shows when the pointer rests on a mark."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import Final
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from matplotlib.path import Path

from hrclog.analyzers.drawing import shapes
from hrclog.analyzers.drawing.fonts import legal
from hrclog.analyzers.drawing.layout import Layout
from hrclog.analyzers.drawing.sheet import Box, Circle, Label, Trace
from hrclog.arrays import FloatArray

_MOST: Final = 2_000
_REACH: Final = 8.0  # px across a line within which it is met
_COARSE: Final = 2.0  # px by which the path that is met may miss the line


def hover(layout: Layout) -> Element:
    """Return a group of invisible shapes that label what lies under the pointer; at most the first 2,000."""
    group = Element("g", {"fill": "none", "stroke": "none", "pointer-events": "all"})
    group.extend(islice(_shapes(layout), _MOST))
    return group


def _shapes(layout: Layout) -> Iterator[Element]:
    yield from (_box(box) for box in shapes.boxes(layout.frame) if box.label)
    yield from (_trace(trace) for trace in shapes.traces(layout.frame) if trace.label)
    yield from (_circle(circle) for circle in shapes.circles(layout.frame) if circle.label)
    yield from (_label(label) for label in layout.sheet.labels if label.full not in {"", label.text})


def _box(box: Box) -> Element:
    left, top, right, bottom = box.bounds
    return _titled_shape("rect", box.label, x=left, y=top, width=right - left, height=bottom - top)


def _circle(circle: Circle) -> Element:
    return _titled_shape("circle", circle.label, cx=circle.at[0], cy=circle.at[1], r=max(circle.radius, _REACH / 2))


def _label(label: Label) -> Element:
    left, top, right, bottom = label.bounds
    return _titled_shape("rect", label.full, x=left, y=top, width=right - left, height=bottom - top)


def _trace(trace: Trace) -> Element:
    shape = _titled_shape("path", trace.label)
    shape.set("d", _path(trace.points))
    shape.set("pointer-events", "stroke")
    shape.set("stroke-width", _number(max(trace.width, _REACH)))
    return shape


def _path(points: FloatArray) -> str:
    full_path = Path(points)
    full_path.simplify_threshold = _COARSE
    path = full_path.cleaned(simplify=True, remove_nans=True)
    codes = np.asarray(path.codes).tolist()
    steps = zip(np.asarray(path.vertices, dtype=np.float64).tolist(), codes, strict=True)
    return "".join(
        f"{'M' if code == Path.MOVETO else 'L'}{_number(x)} {_number(y)}"
        for (x, y), code in steps
        if code in {Path.MOVETO, Path.LINETO}
    )


def _titled_shape(tag: str, text: str, **attributes: float) -> Element:
    shape = Element(tag, {name: _number(value) for name, value in attributes.items()})
    SubElement(shape, "title").text = legal(text)
    return shape


def _number(value: float) -> str:
    return f"{value:.1f}".removesuffix(".0")
