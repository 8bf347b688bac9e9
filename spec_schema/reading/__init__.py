"""Reads a spec with all its files."""
