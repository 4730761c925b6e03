"""The event log on disk: writing, reading, recovering."""
