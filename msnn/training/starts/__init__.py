"""Determines the initial weights of a training."""
