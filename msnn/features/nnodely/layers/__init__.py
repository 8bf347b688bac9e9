"""Writes relations that have weights, sets or tables as layers of a spec."""
