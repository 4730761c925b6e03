"""The few methods of MongoDB's driver that copies of a knowledge base need, without a server."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

from bson import BSON
from pymongo import ReplaceOne

Document = dict[str, Any]


class FakeCollection:
    """Documents by their _id; what cannot be encoded as BSON is refused, as the driver does."""

    def __init__(self) -> None:
        self.documents: dict[str, Document] = {}
        self.calls = 0

    def bulk_write(self, requests: Sequence[ReplaceOne[Document]]) -> None:
        """Carry replacements out."""
        self.calls += 1
        for request in requests:
            assert request._upsert
            assert request._filter == {"_id": request._doc["_id"]}
            encoded = BSON.encode(request._doc)
            self.documents[repr(request._doc["_id"])] = BSON(encoded).decode()

    def delete_many(self, condition: Mapping[str, Any]) -> None:
        """Remove documents that fulfil a condition."""
        self.calls += 1
        kept = {key: document for key, document in self.documents.items() if not _fulfils(document, condition)}
        self.documents = kept


class FakeDatabase(defaultdict[str, FakeCollection]):
    """Collections by name."""

    def __init__(self) -> None:
        super().__init__(FakeCollection)


def _fulfils(document: Document, condition: Mapping[str, Any]) -> bool:
    return all(_holds(_field(document, name), wanted) for name, wanted in condition.items())


def _field(document: Any, name: str) -> Any:  # noqa: ANN401 - any BSON value
    for part in name.split("."):
        document = document.get(part) if isinstance(document, dict) else None
    return document


def _holds(value: Any, wanted: Any) -> bool:  # noqa: ANN401 - any BSON value
    if not isinstance(wanted, dict) or not any(key.startswith("$") for key in wanted):
        return bool(value == wanted)
    assert set(wanted) <= {"$exists", "$nin"}
    exists = "$exists" not in wanted or (value is not None) == wanted["$exists"]
    return exists and value not in wanted.get("$nin", ())
