"""Rigid-body dynamics of robots, written out in core operations."""
