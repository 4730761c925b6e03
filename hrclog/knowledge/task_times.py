"""What is known of how long tasks take: the value that a knowledge base keeps and a plan is judged by.

Work W (seconds) of an execution is lognormal, log W ~ N(mu, sigma^2); while other agents run tasks j it is done at rate
1 / (product of s_j), and before each of its tasks an agent takes a gap. An attempt may fail, and is then tried again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Final

import numpy as np

from hrclog.arrays import FloatArray
from hrclog.json_record import JsonRecord

AgentTask = tuple[str, str]

PRIOR_WEIGHT: Final = 2.0
"""How many observed executions a declared guess is worth."""

GUESS_SIGMA: Final = 0.3
"""Standard deviation of log work that goes with a declared guess: two times in three within 35 % of it."""

TIME_FIELDS: Final = (
    *("agent", "task", "mu", "sigma", "n", "factors", "covariance", "observed_s", "guess_s"),
    *("failure_rate", "failed_s"),
)
GAP_FIELDS: Final = ("agent", "mean_s", "std_s", "n")


@dataclass(frozen=True, slots=True)
class Factor:
    """log of the factor on a task's duration while another agent runs another; n pairs of executions were observed."""

    other_agent: str
    other_task: str
    log_s: float
    n: int


@dataclass(frozen=True, slots=True)
class TaskTime:
    """How long an (agent, task) takes.

    Attributes:
        agent: who.
        task: what.
        mu: mean of log work, work in seconds.
        sigma: standard deviation of log work from one execution to the next.
        n: successful executions that it was learnt from; 0 for a guess.
        factors: those that were observed.
        covariance: of (mu, log sigma, log s of each factor), shape (2 + P, 2 + P); None where not known.
        observed_s: mean duration of those executions, hindrance included; None where there are none.
        guess_s: the declared guess that is part of it, if any.
        failure_rate: part of the attempts that fail, and are tried again.
        failed_s: mean duration of an attempt that fails.
    """

    agent: str
    task: str
    mu: float
    sigma: float
    n: int
    factors: tuple[Factor, ...] = ()
    covariance: FloatArray | None = None
    observed_s: float | None = None
    guess_s: float | None = None
    failure_rate: float = 0.0
    failed_s: float = 0.0

    @property
    def key(self) -> AgentTask:
        """Return (agent, task)."""
        return self.agent, self.task

    @property
    def mean_s(self) -> float:
        """Return the expected work of a success in seconds: its duration beside agents that do not matter."""
        return math.exp(self.mu + self.sigma**2 / 2)

    @property
    def mean_deviation_s(self) -> float | None:
        """Return the standard deviation of what is known of `mean_s`, in seconds; None where not known."""
        if self.covariance is None:
            return None
        direction = np.array([1.0, self.sigma**2])  # of log mean work, mu + sigma^2 / 2, by mu and log sigma
        variance = float(direction @ self.covariance[:2, :2] @ direction)
        return self.mean_s * math.sqrt(max(variance, 0.0))

    @property
    def source(self) -> str:
        """Return learnt, guess, or blend (of both)."""
        if self.guess_s is None:
            return "learnt"
        return "blend" if self.n else "guess"

    def to_json(self) -> dict[str, Any]:
        """Return the time as JSON values, the inverse of `time_from_json`."""
        values: dict[str, Any] = {
            "agent": self.agent,
            "task": self.task,
            "mu": self.mu,
            "sigma": self.sigma,
            "n": self.n,
            "factors": [asdict(factor) for factor in self.factors],
        }
        if self.covariance is not None:
            values["covariance"] = self.covariance.tolist()
        if self.failure_rate:
            values |= {"failure_rate": self.failure_rate, "failed_s": self.failed_s}
        seconds = {"observed_s": self.observed_s, "guess_s": self.guess_s}
        return values | {name: value for name, value in seconds.items() if value is not None}


@dataclass(frozen=True, slots=True)
class Gap:
    """The time from when an agent could start its next task until it does, over n observed ones."""

    agent: str
    mean_s: float
    std_s: float
    n: int

    def to_json(self) -> dict[str, Any]:
        """Return the gap as JSON values."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class TaskTimes:
    """Times by (agent, task), and gaps by agent; both sorted."""

    times: Mapping[AgentTask, TaskTime]
    gaps: Mapping[str, Gap]

    def observed(self, key: AgentTask, other: AgentTask) -> bool:
        """Return whether it was observed how long the first takes while the second runs."""
        time = self.times.get(key)
        return time is not None and any((f.other_agent, f.other_task) == other for f in time.factors)

    def to_json(self) -> dict[str, Any]:
        """Return all as JSON values, the inverse of `task_times_from_json`."""
        return {
            "times": [self.times[key].to_json() for key in sorted(self.times)],
            "gaps": [self.gaps[agent].to_json() for agent in sorted(self.gaps)],
        }


NOTHING: Final = TaskTimes({}, {})
"""Where nothing was learnt yet."""


def task_times_from_json(record: JsonRecord) -> TaskTimes:
    """Return the times of a JSON object with the fields `times` and `gaps`.

    Raises:
        ScenarioError: a field is missing or wrong.
    """
    times = [_time(entry) for entry in record.records("times", TIME_FIELDS, required=False)]
    gaps = [
        Gap(entry.text("agent"), entry.number("mean_s"), entry.number("std_s"), entry.integer("n"))
        for entry in record.records("gaps", GAP_FIELDS, required=False)
    ]
    return TaskTimes(
        {time.key: time for time in sorted(times, key=lambda time: time.key)},
        {gap.agent: gap for gap in sorted(gaps, key=lambda gap: gap.agent)},
    )


def with_guesses(known: TaskTimes, guesses_s: Mapping[AgentTask, float], weight: float = PRIOR_WEIGHT) -> TaskTimes:
    """Return times in which declared guesses stand in for what was not observed, and fade as it is.

    A guess g counts as `weight` executions with log work N(log g, GUESS_SIGMA^2): with n observed ones of mean mu, the
    mean of log work becomes (weight log g + n mu) / (weight + n), its variance that of the mixture of both.

    Args:
        known: what was learnt.
        guesses_s: expected duration of (agent, task) beside agents that do not matter.
        weight: how many observed executions a guess is worth.
    """
    blended = {key: _blend(known.times.get(key), key, guess, weight) for key, guess in guesses_s.items()}
    times = {**known.times, **blended}
    return replace(known, times={key: times[key] for key in sorted(times)})


def _blend(time: TaskTime | None, key: AgentTask, guess_s: float, weight: float) -> TaskTime:
    center = math.log(guess_s)
    if time is None or not time.n:
        spread = np.diag([GUESS_SIGMA**2, 1.0 / (2.0 * weight)])
        return TaskTime(*key, center, GUESS_SIGMA, 0, covariance=spread, guess_s=guess_s)
    share = weight / (weight + time.n)
    mu = share * center + (1 - share) * time.mu
    variance = share * (GUESS_SIGMA**2 + (center - mu) ** 2) + (1 - share) * (time.sigma**2 + (time.mu - mu) ** 2)
    return replace(time, mu=mu, sigma=math.sqrt(variance), guess_s=guess_s)


def _time(entry: JsonRecord) -> TaskTime:
    covariance = [list(row) for row in entry.number_lists("covariance")] if "covariance" in entry else None
    return TaskTime(
        agent=entry.text("agent"),
        task=entry.text("task"),
        mu=entry.number("mu", least=-math.inf),
        sigma=entry.number("sigma"),
        n=entry.integer("n"),
        factors=tuple(
            Factor(
                factor.text("other_agent"),
                factor.text("other_task"),
                factor.number("log_s", least=-math.inf),
                factor.integer("n"),
            )
            for factor in entry.records("factors", [field.name for field in fields(Factor)])
        ),
        covariance=None if covariance is None else np.array(covariance, np.float64),
        observed_s=entry.positive("observed_s") if "observed_s" in entry else None,
        guess_s=entry.positive("guess_s") if "guess_s" in entry else None,
        failure_rate=entry.number("failure_rate", 0.0, most=math.nextafter(1.0, 0.0)),
        failed_s=entry.number("failed_s", 0.0),
    )
