"""Task times without effects between agents: every task lasts as long as on average."""

from __future__ import annotations

import math
from dataclasses import replace

from hrclog.knowledge.task_times import TaskTimes


def by_mean_durations(times: TaskTimes) -> TaskTimes:
    """Return times of tasks that take their mean observed duration, whatever the others do."""
    mean_times = {
        key: time
        if time.observed_s is None
        else replace(time, mu=math.log(time.observed_s) - time.sigma**2 / 2, factors=(), covariance=None)
        for key, time in times.times.items()
    }
    return TaskTimes(mean_times, times.gaps)
