"""Draws simulations, validations and runs with matplotlib, for files and papers."""
