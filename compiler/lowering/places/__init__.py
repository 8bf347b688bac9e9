"""Brings values to the place that they are for."""
