"""Everything that produces events: recorder, executors, importers."""
