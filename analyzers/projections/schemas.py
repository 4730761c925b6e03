"""The columns of every projection, in one place.

Instants `*_ns` are int64 nanoseconds on the recorder's clock, durations `*_s` are seconds. Texts are "" where unset,
numbers null.
"""

from __future__ import annotations

from typing import Final

import polars as pl

INTERVALS: Final = pl.Schema(
    {
        "run_id": pl.String,
        "agent": pl.String,
        "task": pl.String,
        "task_type": pl.String,
        "role": pl.String,  # primary | auxiliary | not_learnt (by annotation)
        "execution_id": pl.String,  # one per attempt
        "parent_execution_id": pl.String,  # set on sub-steps of a sequence
        "item_id": pl.String,  # the plan item; shared by retries
        "attempt": pl.Int64,
        "dispatched_ns": pl.Int64,  # when its agent was told to, null where the log does not say
        "start_ns": pl.Int64,
        "end_ns": pl.Int64,  # null while open
        "until_ns": pl.Int64,  # end_ns; of an open execution its agent's next start, else its run's last sign of life
        "outcome": pl.String,  # succeeded | failed | canceled | skipped | timed_out | unknown | completed
        "reason": pl.String,
        "paused_ns": pl.Int64,  # part of the interval, kept beside it
        "planned_start_ns": pl.Int64,
        "planned_end_ns": pl.Int64,
        "planned_duration_s": pl.Float64,
        "planning_time_s": pl.Float64,
        "path_length": pl.Float64,
        "target": pl.String,
        "path": pl.String,  # file of the start event
    }
)
"""One row per started execution, ordered by (run_id, start_ns, until_ns, agent, task, execution_id)."""

EXECUTIONS: Final = pl.Schema(
    {
        "run": pl.String,  # its name
        "run_id": pl.String,
        "agent": pl.String,
        "task": pl.String,
        "role": pl.String,  # primary | auxiliary
        "attempt": pl.Int64,
        "execution_id": pl.String,  # as in intervals
        "start_s": pl.Float64,  # since the run's first start, as all instants here
        "duration_s": pl.Float64,  # null while open
        "until_s": pl.Float64,  # when it ended; of an open one, until when it is known to have lasted
        "outcome": pl.String,  # as in intervals
        "reason": pl.String,
        "paused_s": pl.Float64,  # part of the duration
        "planned_start_s": pl.Float64,
        "planned_end_s": pl.Float64,
    }
)
"""One row per execution that is no step of a sequence, in the order of the runs and of time; the long table for
statistics. Behind `run_id` stands a column per tag of the runs, and at the end a column `beside_<agent>_s` per agent:
the seconds during which that agent had an execution too, null for the agent itself and in runs without it."""

OVERLAPS: Final = pl.Schema(
    {
        "run_id": pl.String,
        "execution_id": pl.String,
        "agent": pl.String,
        "task": pl.String,
        "other_execution_id": pl.String,
        "other_agent": pl.String,
        "other_task": pl.String,
        "overlap_ns": pl.Int64,
        "ratio": pl.Float64,  # overlap / duration of the execution (the paper's delta)
    }
)
"""One row per ordered pair of executions that overlap; pairs of one agent with itself are included."""

PAIR_OVERLAPS: Final = pl.Schema(
    {
        "agent": pl.String,
        "task": pl.String,
        "other_agent": pl.String,
        "other_task": pl.String,
        "overlap_s": pl.Float64,
        "n": pl.Int64,  # pairs of executions that overlap
        "mean_ratio": pl.Float64,  # over all executions of the task, zeros included
    }
)
"""One row per ordered pair of tasks of different agents, zeros included."""

DURATIONS: Final = pl.Schema(
    {
        "agent": pl.String,
        "task": pl.String,
        "count": pl.Int64,  # executions that succeeded
        "n_failed": pl.Int64,  # failed or timed out
        "n_canceled": pl.Int64,  # canceled or skipped after their start
        "n_censored": pl.Int64,  # still open when the log ended, or ended without an outcome
        "success_rate": pl.Float64,  # count / (count + n_failed)
        "success_low": pl.Float64,  # Wilson 95 %
        "success_high": pl.Float64,
        "mean_s": pl.Float64,
        "std_s": pl.Float64,  # sample (ddof = 1), null below two executions
        "median_s": pl.Float64,
        "q25_s": pl.Float64,
        "q75_s": pl.Float64,
        "min_s": pl.Float64,
        "max_s": pl.Float64,
        "lognormal_mu": pl.Float64,  # of log seconds
        "lognormal_sigma": pl.Float64,
        "lognormal_aic": pl.Float64,
        "gamma_shape": pl.Float64,
        "gamma_scale_s": pl.Float64,
        "gamma_aic": pl.Float64,
    }
)
"""One row per (agent, task) with a primary execution."""

SYNERGIES: Final = pl.Schema(
    {
        "agent": pl.String,
        "task": pl.String,
        "other_agent": pl.String,
        "other_task": pl.String,
        "synergy": pl.Float64,  # duration of (agent, task) while the other runs, over its mean duration; > 1 is bad
        "std_err": pl.Float64,
        "ci_low": pl.Float64,  # 95 %
        "ci_high": pl.Float64,
        "synergy_free": pl.Float64,  # the same over undisturbed work, where the estimator knows it
        "free_std_err": pl.Float64,
        "free_ci_low": pl.Float64,  # 95 %
        "free_ci_high": pl.Float64,
        "n": pl.Int64,  # pairs of executions that overlap and were used; if no_success, that were seen
        "overlap_s": pl.Float64,  # of those pairs
        "status": pl.String,  # ok | sparse (< 5 successes) | weakly_identified | no_success | unobserved
        "estimator": pl.String,
    }
)
"""One row per ordered pair of tasks of different agents. Those that never overlapped (unobserved), and those that
did without a success of the task (no_success), have no numbers, weakly identified ones only those that the data hold;
a regression with no more rows than coefficients has neither errors nor intervals."""

RUNS: Final = pl.Schema(
    {
        "run_id": pl.String(),
        "name": pl.String(),
        "path": pl.String(),  # of its first segment
        "agents": pl.List(pl.String()),
        "start_ns": pl.Int64(),  # first start of an execution
        "end_ns": pl.Int64(),  # last end
        "makespan_s": pl.Float64(),
        "n_executions": pl.Int64(),
        "n_failed": pl.Int64(),
        "n_open": pl.Int64(),
        "outcome": pl.String(),  # of the run; "" when it has no run_ended event
    }
)
"""One row per run, ordered by (start_ns, run_id)."""

METRICS: Final = pl.Schema({"run_id": pl.String, "metric": pl.String, "key": pl.String, "value": pl.Float64})
"""One row per run, metric and key: "H" of an agent, "H|R" of a pair, "H>R" of a direction, "" of the run."""

CRITICAL_PATH: Final = pl.Schema(
    {
        "run_id": pl.String,
        "agent": pl.String,
        "task": pl.String,
        "execution_id": pl.String,
        "item_id": pl.String,
        "earliest_start_ns": pl.Int64,  # were nothing waited for but what must come before
        "earliest_end_ns": pl.Int64,
        "latest_start_ns": pl.Int64,  # without making the longest chain longer
        "latest_end_ns": pl.Int64,
        "slack_ns": pl.Int64,  # latest - earliest
        "critical": pl.Boolean,  # no slack
    }
)
"""One row per execution that is no step of another, as in `INTERVALS`; instants count from the run's first start."""

SIGNALS: Final = pl.Schema({"run_id": pl.String, "name": pl.String, "time_ns": pl.Int64, "value": pl.Float64})
"""One row per sample; joint states are named "agent/joint"."""

SETTLING: Final = pl.Schema({"runs": pl.Int64()} | dict(SYNERGIES))  # of the first so many runs, in order of time
"""One row per number of runs and ordered pair of tasks of different agents, as in `SYNERGIES`."""

SETTLING_DURATIONS: Final = pl.Schema(
    {
        "runs": pl.Int64,  # of the first so many runs, in order of time
        "agent": pl.String,
        "task": pl.String,
        "count": pl.Int64,  # executions that succeeded
        "mean_s": pl.Float64,
        "mean_low_s": pl.Float64,  # Student 95 %, null below two executions
        "mean_high_s": pl.Float64,
    }
)
"""One row per number of runs and (agent, task) with a primary execution."""

PLAN_LABELS: Final = pl.Schema(
    {
        "run_id": pl.String,
        "plan": pl.String,  # equal for runs of the same plan, "" where the log does not say
        "planner": pl.String,  # what made the plan, "" where the log does not say
    }
)
"""One row per run, ordered by run_id."""
