"""Lowers graphs for a group of samples side by side, one in each lane of a vector."""
