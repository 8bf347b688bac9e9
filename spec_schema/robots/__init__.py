"""Robots: URDF files, read without trust into a tree of bodies with constant inertias."""
