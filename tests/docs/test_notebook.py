"""The example notebook runs from its first cell to its last, and shows what it stores."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import nbformat
import pytest
from nbclient import NotebookClient

FOLDER: Final = Path(__file__).parents[2] / "docs"
NOTEBOOK: Final = FOLDER / "notebook.ipynb"


def shown(notebook: Any) -> list[Any]:  # noqa: ANN401 - nbformat has no types
    """Return the results of the cells: their texts by their kind."""
    return [output["data"] for cell in notebook.cells for output in cell.get("outputs", [])]


def our_texts(notebook: Any) -> list[str]:  # noqa: ANN401 - as `shown`
    """Return what hrclog's own values say of themselves; how others print theirs depends on their versions."""
    return [data["text/plain"] for data in shown(notebook) if data["text/plain"].startswith("<hrclog.")]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of the kernel's own parts
def test_the_notebook_runs_and_shows_what_it_stores() -> None:
    stored = nbformat.read(NOTEBOOK, as_version=4)
    executed = nbformat.from_dict(stored.copy())
    NotebookClient(executed, timeout=120, resources={"metadata": {"path": str(FOLDER)}}).execute()
    assert len(our_texts(stored)) == 2
    assert our_texts(executed) == our_texts(stored)
    [page] = [data["text/html"] for data in shown(executed) if data["text/plain"].startswith("<hrclog.Analysis")]
    assert "Synergy: human while robot works" in page
    tables = [data["text/html"] for data in shown(executed) if "text/html" in data]
    assert any("beside_human_s" in table for table in tables)


def test_the_notebook_is_small_and_shows_the_way_from_a_table_to_statistics() -> None:
    assert NOTEBOOK.stat().st_size < 30_000
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbformat.validate(notebook)
    source = "\n".join(cell.source for cell in notebook.cells)
    for step in ("hrclog.from_table(", "hrclog.analyze(", ".executions", ".to_pandas()", "hrclog.save_table("):
        assert step in source
