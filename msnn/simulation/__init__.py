"""Simulates a model on data, and linearises it."""
