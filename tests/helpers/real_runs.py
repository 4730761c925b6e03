"""Some of the authors' runs, as the import of their dumps gives them."""

from __future__ import annotations

import json
from pathlib import Path

from hrclog.recorders.importers.mongo import import_mongo


def import_some(data_dir: Path, folder: Path, n_runs: int) -> Path:
    """Import about so many runs, evenly spread over all of them, and return the folder of their logs."""
    documents = json.loads((data_dir / "safety_areas" / "task_results.json").read_text())
    recipes = sorted({document["recipe"] for document in documents})
    chosen = recipes[:: max(len(recipes) // n_runs, 1)][:n_runs]
    source = folder / "some.json"
    source.write_text(json.dumps([document for document in documents if document["recipe"] in chosen]))
    import_mongo([source], folder / "logs")
    return folder / "logs"
