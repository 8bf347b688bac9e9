"""Robots as parts of a model: a URDF, and the rigid-body dynamics of what it describes."""
