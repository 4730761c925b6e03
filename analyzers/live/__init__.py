"""Runs that are followed while they are recorded: what is told of them is folded in, and drawn in a viewer."""
