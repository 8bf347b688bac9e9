"""Robots: rigid-body dynamics out of URDF files."""
