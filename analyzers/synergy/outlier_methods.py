"""The outlier methods there are, by name, and their use."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Literal

from hrclog.plugins import Registry

if TYPE_CHECKING:
    from hrclog.analyzers.synergy.outliers import OutlierMethod
    from hrclog.arrays import BoolArray, FloatArray

BuiltInOutliers = Literal["none", "isolation-forest"]

Outliers = BuiltInOutliers | str
"""Name of an outlier method."""


OUTLIER_METHODS: Final[Registry[OutlierMethod]] = Registry(
    "outlier method",
    "hrclog.outlier_methods",
    "hrclog.analyzers.synergy.outliers:OutlierMethod",
    {
        "none": "hrclog.analyzers.synergy.outliers:KeepAll",
        "isolation-forest": "hrclog.analyzers.synergy.outliers:Forest",
    },
)
"""The first is the default."""


def inliers(y: FloatArray, method: Outliers) -> BoolArray:
    """Return which rows an outlier method keeps, shape (n,).

    Args:
        y: the regression's left side, shape (n,).
        method: its name.

    Raises:
        PluginError: there is none of that name.
    """
    return OUTLIER_METHODS[method].keep(y)
