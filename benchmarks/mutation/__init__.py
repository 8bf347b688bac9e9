"""Measures how many faults in generated C its own test program detects."""
