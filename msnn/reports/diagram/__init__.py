"""Draws the architecture of a model: its parts in layers, from inputs to outputs."""
