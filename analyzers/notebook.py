"""An analysis as a few kB of HTML, for notebooks: what it holds, how long tasks take, and the heatmap of synergies.

The heatmap is a table with coloured cells: its texts can be selected, it follows the fonts of the notebook, and nothing
that draws has to be loaded. Names are users', so every text is escaped.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from html import escape
from typing import Final

import polars as pl

from hrclog.analyzers.figures.heatmap import Heatmap
from hrclog.analyzers.figures.heatmap_plot import cell_label, cell_text
from hrclog.analyzers.figures.palette import LIGHT, Color, ink_on
from hrclog.analyzers.figures.synergy_heatmap import synergy_heatmaps
from hrclog.analyzers.figures.text import printable, shorten, shorten_apart
from hrclog.analyzers.projections.schemas import RUNS
from hrclog.diagnostic import Diagnostic
from hrclog.wording import counted

_MOST_ROWS: Final = 8
_MOST_HEATMAPS: Final = 2
_MOST_AGENTS: Final = 6
_MOST_TAGS: Final = 8
_NAME: Final = 24
"""The most characters of a name."""
_READING: Final = (
    "Factor on the duration of the row's task while the column's task runs (orange: longer, blue: shorter). "
    "Hover for intervals and counts; * is sparse or weakly identified."
)
_FURTHER: Final = (
    "<code>.executions</code> is the long table, <code>.synergies</code> and <code>.durations</code> are these in "
    "full, <code>.to_report(path)</code> writes everything with pictures."
)


def headline(runs: pl.DataFrame, diagnostics: Sequence[Diagnostic]) -> str:
    """Return in one line what an analysis holds."""
    agents = runs["agents"].explode(empty_as_null=False).unique().sort().to_list()
    names = ", ".join(shorten(agent, _NAME) for agent in agents[:_MOST_AGENTS])
    names += ", ..." if len(agents) > _MOST_AGENTS else ""
    executions = counted(int(runs["n_executions"].sum()), "execution")
    facts = [counted(runs.height, "run"), executions, counted(len(agents), "agent") + (f" ({names})" if agents else "")]
    return ", ".join([*facts, *([counted(len(diagnostics), "diagnostic")] if diagnostics else [])])


def page(
    runs: pl.DataFrame, durations: pl.DataFrame, synergies: pl.DataFrame, diagnostics: Sequence[Diagnostic]
) -> str:
    """Return the HTML of an analysis; the arguments are its frames."""
    heatmaps = synergy_heatmaps(_of_first_pairs(synergies), _MOST_ROWS)
    pairs = synergies.select("agent", "other_agent").n_unique()
    parts = [
        f"<p><b>{escape(headline(runs, []))}</b>{_tags(runs)}</p>",
        _durations(durations),
        *map(_heatmap, heatmaps),
        f"<p>{_READING}{_omitted(pairs - len(heatmaps), 'more pair of agents', 'more pairs of agents')}</p>"
        if heatmaps
        else "",
        _diagnostics(diagnostics),
        f"<p>{_FURTHER}</p>",
    ]
    return f"<div>{''.join(parts)}</div>"


def _tags(runs: pl.DataFrame) -> str:
    """Return the tags of the runs and how many values each has."""
    keys = [name for name in runs.columns if name not in RUNS]
    if not keys:
        return ""
    texts = [f"{shorten(key, _NAME)} ({runs[key].n_unique():,})" for key in keys[:_MOST_TAGS]]
    more = ", ..." if len(keys) > _MOST_TAGS else ""
    return f"<br>tags: {escape(', '.join(texts))}{more}"


def _durations(durations: pl.DataFrame) -> str:
    if durations.is_empty():
        return ""
    rows = [
        (
            *(_name(row[column], shorten(row[column], _NAME)) for column in ("agent", "task")),
            f"{row['count']:,}",
            *(_number(row[column]) for column in ("mean_s", "std_s", "median_s")),
        )
        for row in durations.head(_MOST_ROWS).iter_rows(named=True)
    ]
    head = ("agent", "task", "n", "mean s", "std s", "median s")
    more = _omitted(durations.height - _MOST_ROWS, "more task")
    return _table("Durations of executions that succeeded", head, rows) + (f"<p>{more}</p>" if more else "")


def _heatmap(heatmap: Heatmap) -> str:
    labels = shorten_apart((*heatmap.rows, *heatmap.columns), _NAME)
    head = ("", *(_name(column, labels[column]) for column in heatmap.columns))
    body = "".join(
        f"<tr><th>{_name(name, labels[name])}</th>"
        + "".join(_cell(heatmap, row, column) for column in range(len(heatmap.columns)))
        + "</tr>"
        for row, name in enumerate(heatmap.rows)
    )
    notes = " ".join(text for text in heatmap.captions if "drawn" in text)
    return _framed(heatmap.title, head, body) + (f"<p>{escape(printable(notes))}</p>" if notes else "")


def _cell(heatmap: Heatmap, row: int, column: int) -> str:
    paint = heatmap.paint(float(heatmap.values[row, column]))
    fill = LIGHT[paint] if isinstance(paint, str) else paint
    style = f"background:{_css(fill)};color:{_css(ink_on(fill))}"
    label = escape(shorten(cell_label(heatmap, row, column), 4 * _NAME))
    return f'<td style="{style}" title="{label}">{escape(cell_text(heatmap, row, column))}</td>'


def _diagnostics(diagnostics: Sequence[Diagnostic]) -> str:
    if not diagnostics:
        return ""
    counts = Counter(diagnostic.code for diagnostic in diagnostics).most_common(_MOST_ROWS)
    codes = ", ".join(f"{code} ({number:,})" for code, number in counts)
    return f"<p>{counted(len(diagnostics), 'diagnostic')} in <code>.diagnostics</code>: {escape(codes)}</p>"


def _table(title: str, head: Iterable[str], rows: Iterable[Sequence[str]]) -> str:
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return _framed(title, head, body)


def _framed(title: str, head: Iterable[str], body: str) -> str:
    cells = "".join(f"<th>{cell}</th>" for cell in head)
    return f"<table><caption>{escape(title)}</caption><tr>{cells}</tr>{body}</table>"


def _name(name: str, label: str) -> str:
    """Return the label of a name as HTML, with the name on hover where the label is shorter."""
    whole = printable(name)
    if whole == label:
        return escape(label)
    return f'<span title="{escape(shorten(whole, 4 * _NAME))}">{escape(label)}</span>'


def _of_first_pairs(synergies: pl.DataFrame) -> pl.DataFrame:
    pairs = synergies.select("agent", "other_agent").unique().sort("agent", "other_agent").head(_MOST_HEATMAPS)
    return synergies.join(pairs, on=["agent", "other_agent"], how="semi", maintain_order="left")


def _omitted(number: int, singular: str, plural: str = "") -> str:
    return f" ... and {counted(number, singular, plural)}." if number > 0 else ""


def _number(value: float | None) -> str:
    return "n/a" if value is None else f"{value:,.2f}"


def _css(color: Color) -> str:
    return "#{:02x}{:02x}{:02x}".format(*color)
