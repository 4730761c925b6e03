"""The page that describes a recording: facts, how to read it, and what is not drawn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from hrclog.analyzers.figures.campaign import CampaignFigures
from hrclog.analyzers.figures.plot import page_plots
from hrclog.analyzers.figures.run import RunFigures
from hrclog.analyzers.figures.table import number
from hrclog.analyzers.figures.text import markdown_escape

_RUN_LEGEND: Final = (
    "A lane shows what an agent did; below it, pale, what was planned, and its safety state.",
    "Vermilion and ✗: failed or timed out. Grey and ||: paused. Pale and -: canceled or skipped. #2: second attempt.",
    "Gaps are idle time. A second lane of an agent holds what it did at the same time.",
    "Overlap so far: the time in which both agents have been busy at once.",
)
_CELL_LEGEND: Final = (
    "Cell: a floor area is grey, and lit orange or vermilion while the robot is slowed down or stopped because of it.",
)


def about_run(figures: RunFigures, left_out: Sequence[str] = ()) -> str:
    """Return the markdown page of a run; `left_out` lists what the back end could not draw."""
    legend = _RUN_LEGEND if figures.cell is None else (*_RUN_LEGEND, *_CELL_LEGEND)
    return _page(figures.name, _table(figures.facts), legend, [*figures.captions, *left_out])


def about_campaign(figures: CampaignFigures) -> str:
    """Return the markdown page of a campaign."""
    readings = {plot.reading: page.name for page in reversed(figures.pages) for plot in page_plots(page)}
    legend = [f"{name}: {reading}" for reading, name in reversed(readings.items())]
    return _page(figures.name, _table(figures.facts), legend, figures.captions)


def _page(name: str, facts: Sequence[str], legend: Sequence[str], left_out: Sequence[str]) -> str:
    lines = [f"# {markdown_escape(name)}", "", *facts, "", "## How to read it", "", *_bullets(legend)]
    if left_out:
        lines += ["", "## Not drawn", "", *_bullets(left_out)]
    return "\n".join(lines)


def _table(facts: Sequence[tuple[str, str | float]]) -> list[str]:
    return [
        "| fact | value |",
        "|:--|:--|",
        *[f"| {markdown_escape(name)} | {_format_value(value)} |" for name, value in facts],
    ]


def _bullets(texts: Sequence[str]) -> list[str]:
    return [f"- {markdown_escape(text)}" for text in texts]


def _format_value(value: str | float) -> str:
    return number(value) if isinstance(value, float) else markdown_escape(str(value))
