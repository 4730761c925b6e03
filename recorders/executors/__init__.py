"""Executors: who carries a single task out."""
