"""Carry a plan out: who does what next, checked, limited, retried, and replanned."""
