"""Copies of a knowledge base in MongoDB, under the names and in the shapes that the paper authors' stack reads.

Every document has the same `_id` whenever it is written, so writing twice changes nothing. Documents that are not from
here are left alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import datetime
from typing import TYPE_CHECKING, Any, Final

from hrclog.errors import KnowledgeError
from hrclog.knowledge.base import KnowledgeBase
from hrclog.knowledge.documents import OWN, Document
from hrclog.knowledge.exchange import other_documents, run_documents

if TYPE_CHECKING:
    from pymongo.database import Database

_REMEDY: Final = "expected mongodb://USER@HOST/DATABASE of a server that runs"


def export_mongo(kb: KnowledgeBase, url: str) -> dict[str, int]:
    """Write the four collections into a MongoDB database, and return how many documents each has from here.

    Args:
        kb: the knowledge base.
        url: mongodb://USER@HOST/DATABASE.

    Raises:
        KnowledgeError: the driver is missing, or the server fails.
    """
    safe_url = _without_password(url)
    try:
        from bson import ObjectId
        from pymongo import MongoClient
        from pymongo.errors import PyMongoError
    except ModuleNotFoundError as error:
        reason = f"the package {error.name} is missing"
        raise KnowledgeError(safe_url, reason, "pip install 'hrclog[mongo]'") from error
    try:
        limit: dict[str, Any] = {} if "serverSelectionTimeoutMS" in url else {"serverSelectionTimeoutMS": 5000}
        client: MongoClient[Document] = MongoClient(url, **limit)
        try:
            return write_documents(kb, client.get_default_database(), ObjectId)
        finally:
            client.close()
    except (PyMongoError, ValueError) as error:
        raise KnowledgeError(safe_url, f"the server failed ({str(error)[:200]})", _REMEDY) from error


def write_documents(kb: KnowledgeBase, database: Database[Document], object_id: Callable[[str], Any]) -> dict[str, int]:
    """Write the documents of a knowledge base: those of task_results run by run, then the others.

    Args:
        kb: the knowledge base.
        database: of MongoDB's driver.
        object_id: makes the driver's ids.
    """
    with kb.view() as view:
        by_run, others = run_documents(view), other_documents(view)
    results = database["task_results"]
    for run, of_run in by_run.items():
        _replace_documents(results, of_run, {f"{OWN}.run_id": run}, object_id)
    results.delete_many({f"{OWN}.run_id": {"$exists": True, "$nin": list(by_run)}})
    for name, documents in others.items():
        _replace_documents(database[name], documents, {OWN: {"$exists": True}}, object_id)
    counts = {name: len(documents) for name, documents in others.items()}
    return {"task_results": sum(map(len, by_run.values())), **counts}


def _replace_documents(
    collection: Any,  # noqa: ANN401 - the driver's, or a stand-in
    documents: Sequence[Document],
    origin: Document,
    object_id: Callable[[str], Any],
) -> None:
    """Replace the earlier versions of documents, then remove the documents of `origin` that no longer exist."""
    from pymongo import ReplaceOne

    values = [_driver_value(document, object_id) for document in documents]
    if values:
        collection.bulk_write([ReplaceOne({"_id": value["_id"]}, value, upsert=True) for value in values])
    collection.delete_many({**origin, "_id": {"$nin": [value["_id"] for value in values]}})


def _driver_value(value: Any, object_id: Callable[[str], Any]) -> Any:  # noqa: ANN401 - any JSON value
    """Return a value of extended JSON with the driver's own ids and dates."""
    if isinstance(value, dict):
        if set(value) == {"$oid"}:
            return object_id(value["$oid"])
        if set(value) == {"$date"}:
            return datetime.fromisoformat(value["$date"])
        return {name: _driver_value(entry, object_id) for name, entry in value.items()}
    return [_driver_value(entry, object_id) for entry in value] if isinstance(value, list) else value


def _without_password(url: str) -> str:
    """Return a URL without user and password."""
    scheme, _, rest = url.partition("://")
    return f"{scheme}://{rest.rpartition('@')[2]}"
