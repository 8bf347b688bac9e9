"""Determines the effect of rounding, so that only larger differences count as faults."""
