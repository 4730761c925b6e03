"""A viewer per test."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from rerun.experimental import ViewerClient
from rerun_viewers import viewer_in


@pytest.fixture
def viewer(tmp_path: Path) -> Iterator[ViewerClient]:
    """Give a viewer without a window."""
    with viewer_in(tmp_path) as client:
        yield client
