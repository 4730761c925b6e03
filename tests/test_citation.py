"""Who cites hrclog cites the version that there is, and finds the papers."""

from __future__ import annotations

import re
from pathlib import Path

from hrclog import __version__

CITATION = (Path(__file__).parents[1] / "CITATION.cff").read_text(encoding="utf-8")


def test_the_version_to_cite_is_that_of_hrclog() -> None:
    assert re.findall(r"^version: (.+)$", CITATION, re.MULTILINE) == [__version__]


def test_both_papers_are_named_with_their_authors() -> None:
    references = CITATION.split("\nreferences:\n")[1]
    assert re.findall(r"year: (\d+)", references) == ["2022", "2025"]
    assert re.findall(r"family-names: (\w+)", references) == ["Sandrini", "Faroni", "Pedrocchi"] * 2
