"""Writes relations with weights, sets or tables as layers of a spec."""
