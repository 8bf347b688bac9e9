"""Trains the trials of a comparison in local processes, or on a Ray cluster."""
