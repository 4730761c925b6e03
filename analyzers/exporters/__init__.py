"""Exporters: projections into other formats."""
