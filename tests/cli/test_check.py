"""`hrclog check`: choosing findings by their codes, and explaining codes."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.cli.code_option import DiagnosticCode
from hrclog.diagnostic import CODES
from hrclog.explanations import EXPLANATIONS

if TYPE_CHECKING:
    from conftest import Result

    Run = Callable[..., Result]
else:
    Run = Any

BROKEN_OFF = "broken_off.mcap"


def test_only_shows_and_counts_the_codes_that_are_asked_for(run: Run, samples: Path) -> None:
    every = run("check", samples / BROKEN_OFF, "--json").json()
    codes = {finding["code"] for finding in every["diagnostics"]}
    assert codes == {"open_execution", "missing_from_plan", "run_not_ended"}
    assert every["left_out"] == 0
    for chosen in (["missing_from_plan"], ["open_execution", "run_not_ended"], ["short_run"]):
        only = [argument for code in chosen for argument in ("--only", code)]
        done = run("check", samples / BROKEN_OFF, *only, "--json")
        told = done.json()
        assert told["diagnostics"] == [one for one in every["diagnostics"] if one["code"] in chosen]
        assert told["left_out"] == 3 - len(told["diagnostics"]) == 3 - sum(told["counts"].values())
        assert {code for code in CODES if f"[{code}]" in done.err} == codes & set(chosen)


def test_only_decides_on_the_exit_code(run: Run, samples: Path) -> None:
    strict = ("check", samples / BROKEN_OFF, "--strict")
    assert run(*strict).code == run(*strict, "--only", "missing_from_plan").code == 1
    assert run(*strict, "--only", "run_not_ended").code == run(*strict, "--only", "short_run").code == 0
    killed = samples / "killed.mcap.partial"
    [lost] = [one for one in run("check", killed, "--json").json()["diagnostics"] if one["severity"] == "error"]
    assert run("check", killed, "--only", lost["code"]).code == 3
    assert run("check", killed, "--only", "short_run").code == 0
    assert "of other codes" in run("check", killed, "--only", "short_run").out


@pytest.mark.parametrize(
    ("typed", "near"),
    [
        ("short_rnu", "short_run"),
        ("Clock-Offset", "clock_offset"),
        ("duration", "zero_duration"),
        ("plan", "from_plan"),
    ],
)
@pytest.mark.parametrize("option", ["--only", "--explain"])
def test_an_unknown_code_names_those_that_are_near(option: str, typed: str, near: str, run: Run) -> None:
    done = run("check", option, typed, "nowhere.mcap")
    assert (done.code, done.out) == (2, "")
    assert repr(typed) in done.err
    assert near in " ".join(done.err.split())


def test_a_code_near_to_nothing_names_the_page(run: Run) -> None:
    assert "docs/diagnostics.md" in run("check", "--only", "qqqq", "nowhere.mcap").err


@settings(max_examples=40)
@given(st.sampled_from(sorted(CODES)), st.data())
def test_a_code_with_one_letter_wrong_is_found(code: str, data: st.DataObject) -> None:
    place = data.draw(st.integers(0, len(code) - 1))
    typed = code[:place] + code[place + 1 :]
    if typed not in CODES:
        with pytest.raises(Exception, match=rf"did you mean .*\b{code}\b"):
            DiagnosticCode().convert(typed, None, None)


def test_every_code_is_explained(run: Run) -> None:
    assert list(EXPLANATIONS) == list(CODES)
    for code, explanation in EXPLANATIONS.items():
        for text in (explanation.cause, explanation.remedy):
            assert text.endswith("."), code
            assert "|" not in text, code
            assert "\n" not in text, code
    for code in ("short_run", "truncated", "run_not_ended"):
        severity, meaning = CODES[code]
        explanation = EXPLANATIONS[code]
        assert run("check", "--explain", code).out.splitlines() == [
            f"{code} ({severity}): {meaning}.",
            f"Cause: {explanation.cause}",
            f"What to do: {explanation.remedy}",
        ]
        assert run("check", "--explain", code, "--json").json() == {
            "code": code,
            "severity": severity,
            "meaning": meaning,
            "cause": explanation.cause,
            "remedy": explanation.remedy,
        }


def test_no_log_is_an_error_of_usage(run: Run) -> None:
    done = run("check")
    assert done.code == 2
    assert "Missing argument 'LOG...'" in done.err


def test_an_explanation_loads_no_tables() -> None:
    code = (
        "import sys; from hrclog.cli import main; main(['check', '--explain', 'short_run']); "
        "sys.exit(any(name in sys.modules for name in ('polars', 'numpy', 'hrclog.log.reader')))"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, check=False).returncode == 0
