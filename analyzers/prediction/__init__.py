"""Predict how long executions and runs take, before they happen."""
