"""Compares two models, or two runs: their interfaces, and their accuracy."""
