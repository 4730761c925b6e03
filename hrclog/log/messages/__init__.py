"""Messages and what they mean: events, signals and scenes, encoded and decoded."""
