"""Prints the results of a validation."""
