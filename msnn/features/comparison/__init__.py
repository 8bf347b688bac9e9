"""Compares models: trains several, evaluates them on held-out rows, and measures their C code."""
