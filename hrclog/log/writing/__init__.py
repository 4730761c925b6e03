"""Logs as they are written: the crash-safe journal, and the finished log."""
