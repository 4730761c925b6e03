"""The tables of a knowledge base, the same for SQLite and PostgreSQL.

What is kept of runs (`runs`, `task_results`, `task_properties`, `withdrawals`) is true for good; the rest is statistics
of it, swapped as a whole.
"""

from __future__ import annotations

from typing import Final

from sqlalchemy import BigInteger, Column, Double, MetaData, Table, Text

KNOWLEDGE_VERSION: Final = "1"
"""Of these tables; a knowledge base of another one is not read."""

METADATA: Final = MetaData()


def _text(name: str, *, key: bool = False) -> Column[str]:
    return Column(name, Text, primary_key=key, nullable=False)


def _integer(name: str) -> Column[int]:
    return Column(name, BigInteger)


def _real(name: str) -> Column[float]:
    return Column(name, Double)


META: Final = Table("hrclog_knowledge", METADATA, _text("key", key=True), _text("value"))
"""`schema_version`, by which a knowledge base is known as one."""

RUNS: Final = Table(
    "runs",
    METADATA,
    _text("run_id", key=True),
    _text("digest"),  # SHA-256 of its events
    _text("name"),
    _text("outcome"),  # "" when it has no run_ended event
    _integer("start_ns"),  # first event
    _integer("n_events"),
    _integer("n_executions"),
    _text("snapshot"),  # of task_properties, "" when it declares none
)

WITHDRAWALS: Final = Table("withdrawals", METADATA, _text("run_id", key=True), _text("reason"))
"""Runs that statistics leave out, whether they are there (yet) or not."""

TASK_PROPERTIES: Final = Table(
    "task_properties",
    METADATA,
    _text("snapshot", key=True),  # SHA-256 of what a run_started declares of all tasks
    _text("task", key=True),
    _text("task_type"),
    _text("agents"),  # JSON list
    _text("targets"),  # JSON list
    _text("role"),
    _text("expected_s"),  # JSON object: declared guess of the duration by agent
)

TASK_RESULTS: Final = Table(
    "task_results",
    METADATA,
    _text("run_id", key=True),
    _text("agent"),
    _text("task"),
    _text("task_type"),
    _text("role"),
    _text("execution_id", key=True),
    _text("parent_execution_id"),
    _text("item_id"),
    _integer("attempt"),
    _integer("dispatched_ns"),
    _integer("start_ns"),
    _integer("end_ns"),
    _integer("until_ns"),
    _text("outcome"),
    _text("reason"),
    _integer("paused_ns"),
    _integer("planned_start_ns"),
    _integer("planned_end_ns"),
    _real("planned_duration_s"),
    _real("planning_time_s"),
    _real("path_length"),
    _text("target"),
)
"""The columns of intervals, but for the path of a file."""

RESULT_ORDER: Final = ("run_id", "start_ns", "until_ns", "agent", "task", "execution_id")

TASK_DURATIONS: Final = Table(
    "task_durations",
    METADATA,
    _text("agent"),
    _text("task"),
    _integer("count"),
    _integer("n_failed"),
    _integer("n_canceled"),
    _integer("n_censored"),
    _real("success_rate"),
    _real("success_low"),
    _real("success_high"),
    _real("mean_s"),
    _real("std_s"),
    _real("median_s"),
    _real("q25_s"),
    _real("q75_s"),
    _real("min_s"),
    _real("max_s"),
    _real("lognormal_mu"),
    _real("lognormal_sigma"),
    _real("lognormal_aic"),
    _real("gamma_shape"),
    _real("gamma_scale_s"),
    _real("gamma_aic"),
)

TASK_SYNERGIES: Final = Table(
    "task_synergies",
    METADATA,
    _text("agent"),
    _text("task"),
    _text("other_agent"),
    _text("other_task"),
    _real("synergy"),
    _real("std_err"),
    _real("ci_low"),
    _real("ci_high"),
    _real("synergy_free"),
    _real("free_std_err"),
    _real("free_ci_low"),
    _real("free_ci_high"),
    _integer("n"),
    _real("overlap_s"),
    _text("status"),
    _text("estimator"),
)

TASK_TIMES: Final = Table("task_times", METADATA, _text("kind"), _text("agent"), _text("task"), _text("value"))
"""What plans are judged by, as JSON: `kind` is time or gap, and a gap has the task ""."""

STATISTICS: Final = Table(
    "statistics",
    METADATA,
    _text("statistics_id", key=True),  # SHA-256 of everything that they are made from
    _text("estimator"),
    _integer("estimator_version"),
    _text("outliers"),
)
"""One row, or none where there are no statistics yet."""

STATISTICS_RUNS: Final = Table(
    "statistics_runs",
    METADATA,
    _text("statistics_id", key=True),
    _text("run_id", key=True),
    _text("digest"),
)
"""Which version of which runs the statistics are made from."""

DERIVED: Final = (TASK_DURATIONS, TASK_SYNERGIES, TASK_TIMES, STATISTICS, STATISTICS_RUNS)
"""What is swapped as a whole."""

OF_RUNS: Final = (RUNS, TASK_PROPERTIES, TASK_RESULTS)
"""What comes from logs."""
