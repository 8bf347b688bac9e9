"""Builds exported C and its test harness for the host and for boards."""
