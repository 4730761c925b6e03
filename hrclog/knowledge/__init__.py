"""What was learnt from runs, kept where planners find it."""
