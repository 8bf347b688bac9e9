"""Reads a URDF as a robot: a tree of bodies, and the spec of its dimensions and parameters."""
