"""Builds expressions of a spec: terms, arrays of terms, values along time, names."""
