"""Learnable arrays and their initial values."""
