"""Reads YAML text into a tree of nodes with places."""
