"""Joins a spec and the specs of its sub-models to one spec with full names."""
