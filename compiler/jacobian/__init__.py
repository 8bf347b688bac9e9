"""Derives the Jacobian of one step as core operations."""
