"""Trains the trials of a comparison in processes: of this machine, or of a cluster of Ray."""
