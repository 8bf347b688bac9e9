"""Draws simulations, validations and runs with matplotlib."""
