"""Saves runs: folders, checkpoints, progress, results."""
