"""Tables of executions into logs: CSV, Parquet, Arrow, JSON lines and spreadsheets, by a mapping of their columns."""
