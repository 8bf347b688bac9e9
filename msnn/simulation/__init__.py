"""Runs a model along data, and linearises it."""
