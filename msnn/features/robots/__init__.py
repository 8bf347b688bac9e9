"""Robots as parts of a model: rigid-body dynamics generated from a URDF file."""
