"""Guess what the columns of a table mean, from their names and their values; what could mean two things is refused."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import polars as pl

from hrclog.errors import HrclogError, ImportDataError
from hrclog.recorders.importers.table.instants import TimeSettings, empty_as_null, read_times
from hrclog.recorders.importers.table.mapping import Source, TableMapping
from hrclog.recorders.importers.table.tables import Table
from hrclog.recorders.importers.table.time_units import AmbiguousTimesError
from hrclog.recorders.importers.table.words import END, EVENT_WORDS, OUTCOME_WORDS, START, folded_words

_NAMES: Final = {
    role: names.split()
    for role, names in {
        "agent": (
            "agent actor agentname agentid resource orgresource performer executor subject worker who "
            "operator robot user loggedinuser"
        ),
        "task": (
            "task taskname activity conceptname behavior behaviour action step operation skill subtask taskid "
            "label applicationname name job narration"
        ),
        "start": (
            "start starttime tstart begin begintime started startedat starttimestamp timestart onset from "
            "startdate startdatetime startns startms starts startus startsec beginning"
        ),
        "end": (
            "end endtime tend stop stoptime finish finished finishtime ended endedat endtimestamp "
            "stoptimestamp timeend offset to enddate enddatetime endns endms ends endus endsec completed "
            "completedat"
        ),
        "duration": "duration durations durationms durationsec dur elapsed length took",
        "event": "event eventtype lifecycle lifecycletransition transition phase type state status kind",
        "time": "time timestamp timetimestamp times timems timens instant datetime date t when",
        "outcome": "outcome result success succeeded successful status ok endstate",
        "reason": "reason error errormessage failurereason cause",
        "run": (
            "run runid runname recipe session trial episode recording observationid caseid case caseconceptname "
            "experiment videoid stationname"
        ),
        "execution_id": "executionid execution conceptinstance instanceid uuid goalid",
        "attempt": "attempt attemptnumber try tries retry",
        "planned_start": "plannedstart startplanned tstartplanned plannedstarttime scheduledstart expectedstart",
        "planned_end": "plannedend endplanned tendplanned plannedendtime scheduledend expectedend",
    }.items()
}
"""Names of columns by what they mean, without case and signs."""

_RUN_FACTS: Final = (  # noqa: SIM905 - a list that is read
    "participant participantid subjectid subjectno person group condition mode scenario treatment session "
    "sessionid day block trial trialid trialno trialnumber repetition rep round iteration"
).split()
"""Facts of a run that together tell runs apart where nothing else does."""

_USUAL_AGENTS: Final = {"robot", "human", "operator", "cobot", "worker", "r", "h"}
_YES_NO: Final = (
    ("1", "0"),
    ("true", "false"),
    ("yes", "no"),
    ("y", "n"),
    ("ok", "nok"),
    ("ok", "not ok"),
    ("ok", "error"),
    ("pass", "fail"),
    ("passed", "failed"),
    ("done", "not done"),
)
_SIGNS: Final = re.compile(r"[\W_]+")
_UNIT: Final = re.compile(r"\s*[\[(](?:s|ms|us|ns|sec|seconds)[\])]\s*$", re.IGNORECASE)
_NEEDED: Final = {
    "agent": "COL, or =NAME for all rows",
    "task": "COL, or =NAME for all rows",
    "start": "COL",
    "end": "COL, or --duration COL",
}


def propose(table: Table, given: TableMapping) -> TableMapping:
    """Return the mapping that a table's columns suggest, beside what is given.

    Args:
        table: whose columns are guessed.
        given: what the user said; it stands.

    Raises:
        ImportDataError: a column that is needed is not there, or several could be it.
    """
    if not table.sample.height:
        raise ImportDataError(table.path, "no row below the names of the columns", "at least one", "check the file")
    table = replace(table, sample=_plain_cells(table.sample))
    guesser = _Guesser(table, given)
    mapping = given if given.run or given.tag_columns else _with_run(guesser, given)
    if not (given.start or given.end or given.duration) and (given.time or guesser.has_events()):
        mapping = guesser.fill(mapping, ("event", "time"))
    elif not mapping.is_event_form:
        mapping = guesser.fill(mapping, ("start",))
        mapping = mapping if mapping.end or mapping.duration else guesser.fill(mapping, ("end",), needed=False)
        mapping = mapping if mapping.end or mapping.duration else guesser.fill(mapping, ("duration",), needed=False)
    mapping = guesser.fill(mapping, ("agent", "task"))
    optional = ("outcome", "reason", "execution_id", "attempt", "planned_start", "planned_end")
    mapping = guesser.fill(mapping, optional, needed=False)
    if not mapping.is_event_form and mapping.end is None and mapping.duration is None:
        raise guesser.missing("end")
    return _with_outcome_words(table, mapping)


def _plain_cells(sample: pl.DataFrame) -> pl.DataFrame:
    """Return a sample with the first entry of each list; columns of values with parts of their own are empty."""
    firsts = sample.with_columns(
        pl.col(name).arr.first() if isinstance(kind, pl.Array) else pl.col(name).list.first()
        for name, kind in sample.schema.items()
        if isinstance(kind, pl.List | pl.Array)
    )
    return firsts.with_columns(
        pl.lit(None, pl.String).alias(name)
        for name, kind in firsts.schema.items()
        if kind.is_nested() or kind in (pl.Object, pl.Binary)
    )


class _Guesser:
    """Finds the columns of a table that could mean something."""

    def __init__(self, table: Table, given: TableMapping) -> None:
        self._table = table
        self._given = given
        self._by_name: dict[str, list[str]] = {}
        for name in table.sample.columns:
            for plain in {_plain(name), _plain(_UNIT.sub("", name))}:
                self._by_name.setdefault(plain, []).append(name)
        self._checks: dict[str, Callable[[pl.Series], bool]] = {
            "start": self._are_times, "end": self._are_times, "time": self._are_times, "duration": self._are_times,
            "planned_start": self._are_times, "planned_end": self._are_times, "event": _are_events,
        }  # fmt: skip

    def fill(self, mapping: TableMapping, roles: Sequence[str], *, needed: bool = True) -> TableMapping:
        """Return a mapping with the columns of roles that it lacks.

        Raises:
            ImportDataError: none fits a role that is needed, or several do.
        """
        for role in roles:
            if role in mapping.sources():
                continue
            taken = set(mapping.columns())
            fitting = [name for name in self.columns_of(role) if name not in taken]
            if role == "agent" and not fitting:
                fitting = [name for name in self._table.sample.columns if name not in taken and self._are_agents(name)]
            if len(fitting) > 1:
                raise self._several(role, fitting)
            if fitting:
                mapping = mapping.with_sources({role: Source(column=fitting[0])})
            elif needed:
                raise self.missing(role)
        return mapping

    def columns_of(self, role: str) -> list[str]:
        """Return the columns that could have a role, only the one that is called so if there is one."""
        check = self._checks.get(role, _anything)
        exact = [name for name in self._by_name.get(_plain(role), []) if check(self._table.sample[name])]
        if len(exact) == 1:
            return exact
        names = dict.fromkeys(name for plain in _NAMES[role] for name in self._by_name.get(plain, []))
        return [name for name in names if check(self._table.sample[name])]

    def has_events(self) -> bool:
        """Return whether rows are events: a column of words that begin and end, and no columns of start and end."""
        return bool(self.columns_of("event")) and not (self.columns_of("start") and self.columns_of("end"))

    def run_facts(self) -> list[str]:
        """Return the columns of facts of runs, in the order of the table."""
        known = {name for plain in _RUN_FACTS for name in self._by_name.get(plain, [])}
        return [name for name in self._table.sample.columns if name in known]

    def missing(self, role: str) -> ImportDataError:
        """Return the error of a table without a column that is needed."""
        listed = ", ".join(map(repr, self._table.names[:40])) + (" ..." if len(self._table.names) > 40 else "")
        option = role.replace("_", "-")
        return ImportDataError(
            self._table.path,
            f"no column that is plainly the {role} among {listed}",
            f"one; name it with --{option} {_NEEDED.get(role, 'COL')}",
        )

    def _several(self, role: str, names: Sequence[str]) -> ImportDataError:
        option = role.replace("_", "-")
        listed = " and ".join(map(repr, names))
        return ImportDataError(
            self._table.path, f"columns that could each be the {role}: {listed}", f"one; say which: --{option} COL"
        )

    def _are_times(self, values: pl.Series) -> bool:
        given = self._given
        settings = TimeSettings(given.timezone, given.unit, given.date_order, given.decimal)
        try:
            times = read_times(values, settings)
        except AmbiguousTimesError:
            return True
        except HrclogError:
            return False
        return bool(times.form)

    def _are_agents(self, name: str) -> bool:
        words = set(folded_words(self._table.sample[name]).unique()) - {""}
        return bool(words & _USUAL_AGENTS) and len(words) < 20


def _with_run(guesser: _Guesser, mapping: TableMapping) -> TableMapping:
    """Return a mapping with the columns that tell runs apart; facts of runs are tags too."""
    facts = tuple(guesser.run_facts())
    taken = set(mapping.columns())
    named = [name for name in guesser.columns_of("run") if name not in taken and name not in facts]
    own = tuple(Source(column=name) for name in named[:1]) or tuple(Source(column=name) for name in facts)
    return replace(mapping, run=own, tag_columns=facts)


def _with_outcome_words(table: Table, mapping: TableMapping) -> TableMapping:
    """Return a mapping that says what yes and no mean in a column of outcomes, unless the user said it."""
    if mapping.outcome is None or not mapping.outcome.column or mapping.ok or mapping.failed or mapping.canceled:
        return mapping
    words = set(folded_words(table.sample[mapping.outcome.column]).unique()) - {""}
    pairs = [pair for pair in _YES_NO if words & {*pair}]
    ok, failed = ({pair[at]: None for pair in pairs} for at in (0, 1))
    if not words or not words <= {*ok, *failed, *OUTCOME_WORDS}:
        return mapping
    return replace(mapping, ok=tuple(ok), failed=tuple(failed))


def _anything(_: pl.Series) -> bool:
    return True


def _are_events(values: pl.Series) -> bool:
    words = folded_words(empty_as_null(values))
    kinds = {EVENT_WORDS.get(word) for word in words.unique()}
    return {START, END} <= kinds


def _plain(name: str) -> str:
    return _SIGNS.sub("", name).lower()
