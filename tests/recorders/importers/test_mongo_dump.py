"""The forms in which mongoexport writes the same documents."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from hrclog.recorders.importers.mongo_dump import read_task_results

DOCUMENTS: list[dict[str, Any]] = [
    {"name": "pick", "agent": "R", "recipe": "r_1", "t_start": 1689090425.5583751, "t_end": 1689090431.4405544},
    {"name": "place", "agent": "R", "recipe": "r_1", "t_start": 1689090432, "t_end": 1689090435.25, "outcome": 1},
]  # fmt: skip


def canonical(value: Any) -> Any:  # noqa: ANN401 - any JSON value
    """Return a value in canonical extended JSON."""
    if isinstance(value, dict):
        return {name: canonical(item) for name, item in value.items()}
    if isinstance(value, float):
        return {"$numberDouble": repr(value)}
    return {"$numberInt": str(value)} if isinstance(value, int) else value


@pytest.mark.parametrize(
    "text",
    [
        json.dumps(DOCUMENTS),
        "\n".join(json.dumps(document) for document in DOCUMENTS) + "\n",
        "\ufeff" + json.dumps(DOCUMENTS),
        json.dumps([canonical(document) for document in DOCUMENTS]),
        "\n".join(json.dumps(canonical(document)) for document in DOCUMENTS),
    ],
    ids=["array", "lines", "byte order mark", "canonical array", "canonical lines"],
)
def test_every_form_gives_the_same_documents(text: str, tmp_path: Path) -> None:
    source = tmp_path / "dump.json"
    source.write_text(text, encoding="utf-8")
    assert read_task_results(source) == (DOCUMENTS, [])
