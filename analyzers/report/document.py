"""What a report holds, in order: findings, pages of figures, tables, single runs, methods."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from itertools import count
from typing import TYPE_CHECKING, Final

import polars as pl

from hrclog.analyzers.figures.exclusions import exclusion_table
from hrclog.analyzers.figures.plot import Page, Plot
from hrclog.analyzers.figures.run import RunFigures
from hrclog.analyzers.figures.run_plots import run_plots
from hrclog.analyzers.figures.table import DataTable, number
from hrclog.analyzers.figures.text import printable, shorten
from hrclog.analyzers.projections.tags import tags_summary
from hrclog.analyzers.report.finding import Finding
from hrclog.analyzers.report.findings import findings
from hrclog.analyzers.report.methods import Remark, definitions, provenance, remarks
from hrclog.analyzers.report.sample import Chosen, choose_runs, sample_sentence
from hrclog.analyzers.report.tables import PageTable, page_table
from hrclog.errors import HrclogError
from hrclog.wording import counted

if TYPE_CHECKING:
    from hrclog.analyzers.result import Analysis

DEFAULT_RUNS: Final = 4

_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_LONGEST_ENTRY: Final = 40  # characters of a run's name in the contents


@dataclass(frozen=True, slots=True, eq=False)
class Figure:
    """A plot with its number in the report. `stages` holds (number of runs, plot) if the plot grew with the runs."""

    number: int
    plot: Plot
    stages: tuple[tuple[int, Plot], ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """Figures that are looked at together."""

    anchor: str
    name: str
    figures: tuple[Figure, ...]


@dataclass(frozen=True, slots=True, eq=False)
class RunSection:
    """One run: why it is shown, facts, figures, executions, events, and what is not drawn."""

    anchor: str
    name: str
    entry: str
    why: str
    facts: tuple[tuple[str, str], ...]
    figures: tuple[Figure, ...]
    executions: PageTable
    events: PageTable
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Report:
    """The content of a report, before anything is drawn."""

    title: str
    summary: str
    findings: tuple[Finding, ...]
    not_drawn: tuple[str, ...]
    sections: tuple[Section, ...]
    tables: tuple[PageTable, ...]
    sample: str
    chosen: tuple[Chosen, ...]
    runs: tuple[RunSection, ...]
    definitions: tuple[tuple[str, str], ...]
    provenance: tuple[tuple[str, str], ...]
    remarks: tuple[Remark, ...]

    @property
    def figures(self) -> tuple[Figure, ...]:
        """Return all figures, by their numbers."""
        groups: tuple[Section | RunSection, ...] = (*self.sections, *self.runs)
        return tuple(figure for group in groups for figure in group.figures)


def report(analysis: Analysis, *, runs: int = DEFAULT_RUNS, title: str = "", command: str = "") -> Report:
    """Return the content of a report. The same analysis gives the same report.

    Args:
        analysis: what is reported on.
        runs: how many single runs are shown, see `sample.choose_runs`.
        title: of the report; "" says how many runs it is about.
        command: how it was asked for; "" leaves that out.

    Raises:
        HrclogError: no agent did anything, or an argument is not what it should be.
    """
    _check_arguments(runs, title)
    _check_executions(analysis)
    numbers = count(1)
    figures = analysis.campaign_figures()
    sections = tuple(_section(f"page-{place}", page, numbers) for place, page in enumerate(figures.pages, 1))
    chosen = choose_runs(analysis.runs, runs)
    return Report(
        title=printable(title) if title.strip() else f"Report on {counted(analysis.runs.height, 'run')}",
        summary=_summary(analysis),
        findings=findings(analysis),
        not_drawn=figures.captions,
        sections=sections,
        tables=tuple(
            page_table(table, f"table-{table.name}")
            for table in (*figures.tables, *exclusion_table(analysis.exclusions))
        ),
        sample=sample_sentence(chosen, analysis.runs.height),
        chosen=chosen,
        runs=tuple(
            _run_section(f"run-{place}", run, analysis.run_figures(run.run_id), numbers)
            for place, run in enumerate(chosen, 1)
        ),
        definitions=definitions(analysis),
        provenance=provenance(analysis, command),
        remarks=remarks(analysis),
    )


def _check_arguments(runs: object, title: object) -> None:
    if not isinstance(runs, int) or runs < 0:
        raise HrclogError(f"runs is {runs!r}, expected how many single runs to show, 0 or more")
    if not isinstance(title, str):
        raise HrclogError(f"title is {title!r}, expected a text")


def _check_executions(analysis: Analysis) -> None:
    if analysis.intervals.is_empty():
        runs = counted(analysis.runs.height, "run")
        raise HrclogError(
            f"no agent did anything in {runs}, expected executions to report on; `hrclog info` says what the logs hold"
        )


def _section(anchor: str, page: Page, numbers: Iterator[int]) -> Section:
    stage_groups = (tuple(zip(steps.numbers, steps.plots, strict=True)) for steps in page.steps)
    figures = [Figure(next(numbers), plot) for plot in page.plots]
    figures += [Figure(next(numbers), stages[-1][1], stages) for stages in stage_groups if stages]
    return Section(anchor, page.name, tuple(figures))


def _run_section(anchor: str, chosen: Chosen, run: RunFigures, numbers: Iterator[int]) -> RunSection:
    lines = run.events
    events = pl.DataFrame(
        {"time_s": [time / 1e9 for time in lines.times_ns], "level": lines.levels, "event": lines.texts},
        schema={"time_s": pl.Float64, "level": pl.String, "event": pl.String},
    )
    log = DataTable("events", "Events", events, "Seconds since the run's first event.")
    name = printable(run.label)
    return RunSection(
        anchor=anchor,
        name=name,
        entry=shorten(name, _LONGEST_ENTRY),
        why=chosen.why,
        facts=tuple((name, _format_value(value)) for name, value in run.facts if name != "run"),
        figures=tuple(Figure(next(numbers), plot) for plot in run_plots(run)),
        executions=page_table(run.tasks, f"{anchor}-executions"),
        events=page_table(log, f"{anchor}-events"),
        notes=run.captions,
    )


def _format_value(value: str | float) -> str:
    return number(value) if isinstance(value, float) else printable(str(value))


def _summary(analysis: Analysis) -> str:
    """Return a sentence that says what the report is about."""
    agents = sorted(analysis.intervals["agent"].unique().to_list())
    names = ", ".join(printable(agent) for agent in agents)
    days = _days(analysis.runs["start_ns"].drop_nulls().to_list())
    runs = f"{counted(analysis.runs.height, 'run')} of {counted(len(agents), 'agent')} ({names})"
    text = f"{runs}{days}, {counted(analysis.intervals.height, 'execution')}."
    tags = tags_summary(analysis.runs)
    return f"{text} Tags: {printable(tags)}." if tags else text


def _days(starts_ns: Iterable[int]) -> str:
    days = sorted({_day(start) for start in starts_ns})
    if not days:
        return ""
    return f" on {days[0]} (UTC)" if len(days) == 1 else f" between {days[0]} and {days[-1]} (UTC)"


def _day(time_ns: int) -> str:
    return (_EPOCH + timedelta(seconds=time_ns // 10**9)).date().isoformat()
