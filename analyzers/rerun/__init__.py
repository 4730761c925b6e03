"""The Rerun back end: recordings that open laid out, and their viewer."""
