"""Lowers graphs to integer nodes, and bounds the rounding errors."""
