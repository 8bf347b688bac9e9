"""Builds what a spec says of a model: terms, arrays of them, values along time, names."""
