"""Integrates continuous states over a sample."""
