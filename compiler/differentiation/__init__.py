"""Derives graphs in reverse and forward mode."""
