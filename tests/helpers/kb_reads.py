"""The tables of a knowledge base, each from a view of its own."""

from __future__ import annotations

import polars as pl

from hrclog.knowledge.base import KnowledgeBase


def results(kb: KnowledgeBase) -> pl.DataFrame:
    """Return the executions of the runs that are not withdrawn."""
    with kb.view() as view:
        return view.results()


def durations(kb: KnowledgeBase) -> pl.DataFrame:
    """Return what is known of durations."""
    with kb.view() as view:
        return view.durations()


def synergies(kb: KnowledgeBase) -> pl.DataFrame:
    """Return the synergies of pairs of tasks."""
    with kb.view() as view:
        return view.synergies()
