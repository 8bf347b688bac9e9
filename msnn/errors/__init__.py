"""Constructors of the diagnostics of data, weights, training and commands."""
