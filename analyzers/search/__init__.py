"""Judge plans by what was learnt, and find good ones."""
