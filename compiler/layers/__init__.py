"""Layers: composite operations that expand into core operations, one file each."""
