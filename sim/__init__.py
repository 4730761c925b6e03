"""Simulated workcells that write the same logs as real ones."""
