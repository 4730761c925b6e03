"""Projections: frames that are folded from the events of logs."""
