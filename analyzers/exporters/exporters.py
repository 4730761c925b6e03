"""The available exporters by name; the first is the default."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from hrclog.plugins import Registry

if TYPE_CHECKING:
    from hrclog.analyzers.exporters.exporter import Exporter

EXPORTERS: Final[Registry[Exporter]] = Registry(
    "exporter",
    "hrclog.exporters",
    "hrclog.analyzers.exporters.exporter:Exporter",
    {
        "csv": "hrclog.analyzers.exporters.tables:Csv",
        "parquet": "hrclog.analyzers.exporters.tables:Parquet",
        "spss": "hrclog.analyzers.exporters.spss:Spss",
    },
)
