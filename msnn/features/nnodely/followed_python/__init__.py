"""Interprets the source of Python functions symbolically, without running it."""
