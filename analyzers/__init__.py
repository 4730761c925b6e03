"""Everything that reads logs: intervals, overlaps, durations, synergies, metrics, pictures."""
