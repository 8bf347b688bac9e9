"""Analyses single columns of a log: sampling, values, faults."""
