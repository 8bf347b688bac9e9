"""Rigid-body dynamics of a robot as numbers and scalars of a graph."""
