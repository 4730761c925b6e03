"""Importers: other systems' records into event logs."""
