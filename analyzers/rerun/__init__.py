"""The Rerun back end: recordings that open with a layout, and their viewer."""
