"""Derives graphs that compute the Jacobian of one step."""
