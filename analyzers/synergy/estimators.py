"""The estimators by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from hrclog.analyzers.synergy.aft import aft
from hrclog.analyzers.synergy.bayes import bayes
from hrclog.analyzers.synergy.fit import Fit
from hrclog.analyzers.synergy.mean import mean
from hrclog.analyzers.synergy.observations import Observations
from hrclog.analyzers.synergy.ols import ols, paper
from hrclog.analyzers.synergy.outliers import Outliers

Estimator = Callable[[Observations, Outliers], Fit]
"""Takes observations and how to treat outliers; returns a table, covariances and models that predict."""

ESTIMATORS: Final[dict[str, Estimator]] = {"aft": aft, "bayes": bayes, "ols": ols, "paper": paper}
"""Those that learn synergies; the first is the default."""

YARDSTICKS: Final[dict[str, Estimator]] = {"mean": mean}
"""Those that others are compared with."""

OUTLIERS: Final[tuple[Outliers, ...]] = ("none", "isolation-forest")
