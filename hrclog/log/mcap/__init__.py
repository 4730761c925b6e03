"""The bytes of an MCAP file: its records, by index or front to end, and whether all of them are there."""
