"""The public face: every name resolves, an editor completes it, and words that may be given are those of the tables."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path
from typing import get_args

import pytest

import hrclog
from hrclog.analyzers.search.judge import Objective
from hrclog.analyzers.search.methods import METHODS, OBJECTIVES
from hrclog.analyzers.search.search import SEARCHES
from hrclog.analyzers.search.wish import Method
from hrclog.analyzers.synergy.estimators import ESTIMATORS, BuiltInEstimator
from hrclog.analyzers.synergy.outlier_methods import OUTLIER_METHODS, BuiltInOutliers
from hrclog.planning.dispatch_mode import MODES, DispatchMode
from hrclog.sim.bullet.safety import _MAKERS
from hrclog.sim.cell.safety_settings import POLICIES

TREE = ast.parse(Path(hrclog.__file__).read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", hrclog.__all__)
def test_a_name_resolves_to_what_its_module_defines(name: str) -> None:
    value = getattr(hrclog, name)
    if name in hrclog._LAZY:
        assert value is getattr(importlib.import_module(hrclog._LAZY[name]), name)


def test_an_editor_sees_what_is_imported_lazily() -> None:
    [typed] = [node for node in TREE.body if isinstance(node, ast.If)]
    seen = {alias.name: node.module for node in typed.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert seen == hrclog._LAZY
    assert set(hrclog.__all__) == {*hrclog._LAZY, "HrclogError", "__version__"}


def test_words_that_an_editor_completes_are_those_of_the_tables() -> None:
    assert get_args(BuiltInEstimator) == ESTIMATORS.builtins
    assert get_args(BuiltInOutliers) == OUTLIER_METHODS.builtins


def test_what_was_public_still_is() -> None:
    before = """
        Analysis HrclogError Logs Recorder TaskHandle Wish __version__ analyze durations find_plan intervals metrics
        open_knowledge overlaps read_events read_logs replanner
    """
    assert set(before.split()) <= set(hrclog.__all__)


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'analyse'"):
        _ = hrclog.analyse  # type: ignore[attr-defined] - the mistake that is tested


def test_enumerations_are_those_of_their_tables() -> None:
    assert list(MODES) == list(DispatchMode)
    assert list(METHODS) == list(Method)
    assert ["auto", *SEARCHES] == list(METHODS)
    assert list(_MAKERS) == list(POLICIES)
    assert list(OBJECTIVES) == list(Objective)
