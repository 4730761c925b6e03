"""Lints: what a careful reader of the data would want to know, though nothing was lost; one idea a module."""
