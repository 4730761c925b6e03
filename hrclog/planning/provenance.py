"""Where a plan comes from: the problem that it was made for, and the makespan that it promises."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import Any, Final

from hrclog.json_record import JsonRecord
from hrclog.planning.problem import Problem

MADE_FOR_FIELDS: Final = ("name", "digest")
FORECAST_FIELDS: Final = ("mean_s", "mean_low_s", "mean_high_s", "run_low_s", "run_high_s", "worlds", "mode")

_DIGITS: Final = 16  # of the digest, as hexadecimal text


@dataclass(frozen=True, slots=True)
class MadeFor:
    """The problem that a plan was made for.

    Attributes:
        name: of a scenario, or the path of a file, as whoever made the plan gave it.
        digest: of the problem, so that a changed one is noticed.
    """

    name: str
    digest: str

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON values."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Expected:
    """The makespan that was expected when a plan was made, in seconds.

    Attributes:
        mean_s: expected over what is not known and how executions vary.
        mean_low_s: lower end of the 95 % interval of that expectation.
        mean_high_s: its upper end.
        run_low_s: 5 % quantile of one run's makespan.
        run_high_s: its 95 % quantile.
        worlds: how many runs were drawn.
        mode: the dispatch mode in which they were drawn; "" where it is not known.
    """

    mean_s: float
    mean_low_s: float
    mean_high_s: float
    run_low_s: float
    run_high_s: float
    worlds: int
    mode: str = ""

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON values."""
        return asdict(self)


def made_for(name: str, problem: Problem) -> MadeFor:
    """Return the facts by which a plan names its problem.

    Args:
        name: of the scenario, or the path of its file.
        problem: as it is now.
    """
    return MadeFor(name, problem_digest(problem))


def problem_digest(problem: Problem) -> str:
    """Return the first 16 hexadecimal digits of the SHA-256 of a problem's JSON form."""
    text = json.dumps(problem.to_json(), sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:_DIGITS]


def made_for_from_json(record: JsonRecord) -> MadeFor:
    """Return the problem of a plan file.

    Raises:
        ScenarioError: a field is missing or wrong.
    """
    return MadeFor(record.text("name"), record.text("digest", ""))


def expected_from_json(record: JsonRecord) -> Expected:
    """Return the expected makespan of a plan file.

    Raises:
        ScenarioError: a field is missing or wrong.
    """
    seconds = {name: record.number(name) for name in FORECAST_FIELDS[:-2]}
    return Expected(worlds=record.integer("worlds"), mode=record.text("mode", ""), **seconds)
