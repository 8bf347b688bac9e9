"""Lowers graphs to integer nodes, and bounds what rounding costs."""
