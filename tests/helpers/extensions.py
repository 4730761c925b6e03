"""An estimator, an importer and an exporter as users would write them, in a module that workers can import."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import polars as pl

from hrclog import Coefficient, Estimator, Exporter, Fit, Foreign, Importer, Observations
from hrclog.events import Event, RunEnded, RunStarted, TaskEnded, TaskStarted
from hrclog.ids import derived_id
from hrclog.recorders.importers.importer import Imported, Option, Remark


class MedianRatio(Estimator):
    """The median duration of executions that met a task, over the median of all; quartiles for an interval."""

    name = "median-ratio"
    summary = "median of those that met the other task, over the median of all"
    assumes = "a ratio of medians, which takes a meeting of any length for a whole one."
    caution = "By median-ratio all meetings count alike, however short."

    def fit(self, observations: Observations, outliers: str = "none") -> Fit:  # noqa: ARG002 - an estimator's signature
        """Return the ratios."""
        pair, seconds = ["agent", "task", "other_agent", "other_task"], pl.col("duration_s")
        good = observations.executions.filter("finished")
        usual = good.group_by("agent", "task").agg(seconds.median().alias("all"))
        quartiles = [
            seconds.quantile(level).alias(name) for name, level in (("mid", 0.5), ("low", 0.25), ("top", 0.75))
        ]
        rows = observations.pairs.group_by(pair).agg(quartiles).join(usual, on=["agent", "task"]).sort(pair)
        return self.result(
            observations,
            [
                Coefficient(*row[:4], row[4] / row[7], (row[6] - row[5]) / row[7], row[5] / row[7], row[6] / row[7])
                for row in rows.iter_rows()
            ],
        )


class Broken(Estimator):
    """Raises an error of its own."""

    name = "broken"

    def fit(self, observations: Observations, outliers: str = "none") -> Fit:  # noqa: ARG002 - an estimator's signature
        """Fail."""
        raise ZeroDivisionError("nothing to divide by")


class Shapeless(Estimator):
    """Returns no fit."""

    name = "shapeless"

    def fit(self, observations: Observations, outliers: str = "none") -> Fit:  # noqa: ARG002 - an estimator's signature
        """Return a frame."""
        return observations.executions  # type: ignore[return-value] - the mistake that is tested


class OtherTable(Estimator):
    """Returns a table of other columns."""

    name = "other-table"

    def fit(self, observations: Observations, outliers: str = "none") -> Fit:  # noqa: ARG002 - an estimator's signature
        """Return a fit without statuses."""
        fit = self.result(observations, [])
        return Fit(fit.synergies.drop("status"), fit.models)


class TakenName(Estimator):
    """Has the name of a built-in."""

    name = "aft"

    def fit(self, observations: Observations, outliers: str = "none") -> Fit:  # noqa: ARG002 - an estimator's signature
        """Return nothing learnt."""
        return self.result(observations, [])


class Diary(Importer):
    """Lines of run, agent, task, start and end in seconds."""

    name = "diary"
    summary = "Import diaries: CSV lines of run, agent, task, start, end."
    options = (Option("offset_s", "Seconds to add to every instant.", float, 0.0),)

    def read(self, sources: Sequence[Path], *, offset_s: float = 0.0, **_: object) -> Foreign:
        """Return the runs of diaries."""
        rows = [row for source in sources for row in csv.reader(source.read_text(encoding="utf-8").splitlines())]
        runs: dict[str, list[list[str]]] = {}
        for row in rows:
            runs.setdefault(row[0], []).append(row)
        return Foreign(list(runs), lambda run: list(_events(run, runs[run], offset_s)), len(rows))

    def remark(self, imported: Imported, **_: object) -> Remark:
        """Count the runs."""
        return Remark(f"{len(imported.runs)} diaries", values={"diaries": len(imported.runs)})


def _events(run: str, rows: list[list[str]], offset_s: float) -> list[Event]:
    run_id = derived_id("diary", run)
    facts: list[tuple[int, Event]] = []
    for number, (_, agent, task, start, end) in enumerate(rows):
        begin_ns, end_ns = (round((float(second) + offset_s) * 1e9) for second in (start, end))
        who = {"run_id": run_id, "agent": agent, "task": task, "execution_id": derived_id("diary", run, str(number))}
        facts += [
            (begin_ns, TaskStarted(time_ns=begin_ns, **who)),
            (end_ns, TaskEnded(time_ns=end_ns, **who)),
        ]
    ordered = [event for _, event in sorted(facts, key=lambda fact: fact[0])]
    first, last = ordered[0].time_ns, ordered[-1].time_ns
    return [RunStarted(time_ns=first, run_id=run_id, name=run), *ordered, RunEnded(time_ns=last, run_id=run_id)]


class Markdown(Exporter):
    """Tables in Markdown."""

    name = "markdown"
    summary = "tables in Markdown"
    suffix = ".md"

    def write(self, frame: pl.DataFrame, path: Path) -> None:
        """Write the rows between bars."""
        lines = [frame.columns, ["---"] * frame.width, *(map(str, row) for row in frame.iter_rows())]
        path.write_text("\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n", encoding="utf-8")


class Stranger(Estimator):
    """Knows a coefficient of somebody whom nobody observed."""

    name = "stranger"

    def fit(self, observations: Observations, outliers: str = "none") -> Fit:  # noqa: ARG002 - an estimator's signature
        """Return it."""
        return self.result(observations, [Coefficient("bob", "cook", "robot", "pick_blue_box", 2.0)])


class Wordy(Stranger):
    """Gives a text for a number."""

    name = "wordy"

    def fit(self, observations: Observations, outliers: str = "none") -> Fit:  # noqa: ARG002 - an estimator's signature
        """Return it."""
        pair = observations.pairs.select("agent", "task", "other_agent", "other_task").row(0)
        return self.result(observations, [Coefficient(*pair, "2.0")])  # type: ignore[arg-type] - the mistake that is tested


class Quits(Stranger):
    """Ends the program."""

    name = "quits"

    def fit(self, observations: Observations, outliers: str = "none") -> Fit:  # noqa: ARG002 - an estimator's signature
        """Quit."""
        raise SystemExit(0)


class Negative(Stranger):
    """Gives a factor that no duration can have."""

    name = "negative"

    def fit(self, observations: Observations, outliers: str = "none") -> Fit:  # noqa: ARG002 - an estimator's signature
        """Return it."""
        pair = observations.pairs.select("agent", "task", "other_agent", "other_task").row(0)
        return self.result(observations, [Coefficient(*pair, -3.0)])
