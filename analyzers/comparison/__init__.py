"""What differs between two sets of runs, table by table, and how sure one can be of it."""
