"""What was said of runs afterwards, in a file beside their log, which itself is never rewritten."""
