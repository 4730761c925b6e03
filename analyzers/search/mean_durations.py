"""What is known if tasks are taken to last as long as on average, whatever the others do."""

from __future__ import annotations

import math
from dataclasses import replace

from hrclog.knowledge.task_times import TaskTimes


def by_mean_durations(times: TaskTimes) -> TaskTimes:
    """Return times of tasks that take their mean observed duration, whatever the others do."""
    flat = {
        key: time
        if time.observed_s is None
        else replace(time, mu=math.log(time.observed_s) - time.sigma**2 / 2, factors=(), covariance=None)
        for key, time in times.times.items()
    }
    return TaskTimes(flat, times.gaps)
