"""The cell that a scenario describes: robot, human, tables, boxes and safety settings."""
