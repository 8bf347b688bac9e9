"""Diagnostics of training, of its runs and of weights."""
