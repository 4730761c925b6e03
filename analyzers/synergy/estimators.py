"""The estimators there are, by name: the one table that command line, report, scores and knowledge bases read."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Literal, TypeVar

from hrclog.plugins import Registry

if TYPE_CHECKING:
    from hrclog.analyzers.synergy.estimator import Estimator

BuiltInEstimator = Literal["aft", "bayes", "ols", "paper"]

EstimatorName = BuiltInEstimator | str
"""Of a built-in, of one that was registered, or `package.module:NAME`."""

_BASE: Final = "hrclog.analyzers.synergy.estimator:Estimator"

ESTIMATORS: Final[Registry[Estimator]] = Registry(
    "estimator",
    "hrclog.estimators",
    _BASE,
    {
        "aft": "hrclog.analyzers.synergy.aft:Aft",
        "bayes": "hrclog.analyzers.synergy.bayes:Bayes",
        "ols": "hrclog.analyzers.synergy.ols:Ols",
        "paper": "hrclog.analyzers.synergy.ols:Paper",
    },
)
"""Those that learn synergies; the first is the default."""

YARDSTICKS: Final[Registry[Estimator]] = Registry(
    "yardstick", "", _BASE, {"mean": "hrclog.analyzers.synergy.mean:Mean"}
)
"""Those that others are compared with in `score`."""

DEFAULT_ESTIMATOR: Final = ESTIMATORS.default

NewEstimator = TypeVar("NewEstimator", bound="type[Estimator]")


def register_estimator(estimator: NewEstimator) -> NewEstimator:
    """Make a class of yours known under its `name`, wherever an estimator is named in this process.

    It may be used as a decorator.

    Args:
        estimator: a subclass of `hrclog.Estimator`.

    Raises:
        PluginError: it is no such class, or its name is taken.
    """
    ESTIMATORS.register(estimator)
    return estimator


def scored(name: str) -> Estimator:
    """Return an estimator or a yardstick by name.

    Raises:
        PluginError: there is none of that name.
    """
    return YARDSTICKS[name] if name in YARDSTICKS.builtins else ESTIMATORS[name]
