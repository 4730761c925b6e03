"""Clocks of agents: what the events say of them, and times brought to one clock."""
