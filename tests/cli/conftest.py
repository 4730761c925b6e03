"""Run the command line in this process."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from hrclog.cli import main

SAMPLES = Path(__file__).parents[2] / "sample_logs"


@dataclass(frozen=True)
class Result:
    """What a command did."""

    code: int
    out: str
    err: str

    def json(self) -> Any:  # noqa: ANN401 - whatever the command says
        """Return standard output as JSON; fails if anything else is in it."""
        return json.loads(self.out)


@pytest.fixture
def run(capfd: pytest.CaptureFixture[str]) -> Callable[..., Result]:
    def call(*arguments: str | Path) -> Result:
        capfd.readouterr()
        code = main([str(argument) for argument in arguments])
        out, err = capfd.readouterr()
        return Result(code, out, err)

    return call


@pytest.fixture(scope="session")
def samples() -> Path:
    return SAMPLES


@dataclass(frozen=True)
class Analyzed:
    """What `hrclog analyze` makes of the sample campaign: a folder, and JSON on standard output."""

    folder: Path
    out: str


@pytest.fixture(scope="session")
def analyzed(samples: Path, tmp_path_factory: pytest.TempPathFactory) -> Analyzed:
    """Return an analysis that many tests look at and none changes."""
    folder = tmp_path_factory.mktemp("analyzed")
    with redirect_stdout(io.StringIO()) as out:
        assert main(["analyze", str(samples / "campaign"), "-o", str(folder), "--json"]) == 0
    return Analyzed(folder, out.getvalue())
