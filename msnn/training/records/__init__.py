"""Keeps runs: folders, checkpoints, progress, results."""
