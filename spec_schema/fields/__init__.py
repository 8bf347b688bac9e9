"""Scalar readers and base classes for the sections of a spec."""
