"""The importers there are, by name."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from hrclog.plugins import Registry

if TYPE_CHECKING:
    from hrclog.recorders.importers.importer import Importer

IMPORTERS: Final[Registry[Importer]] = Registry(
    "importer",
    "hrclog.importers",
    "hrclog.recorders.importers.importer:Importer",
    {
        "bag": "hrclog.recorders.importers.bag:Bag",
        "mongo": "hrclog.recorders.importers.mongo:Mongo",
        "table": "hrclog.recorders.importers.table.importer:TableImporter",
    },
)
