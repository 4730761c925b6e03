"""Synergy estimators, one a file."""
