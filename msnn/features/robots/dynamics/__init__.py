"""Rigid-body dynamics of a robot, computed with constants and scalar graph nodes."""
