"""Follows the source of Python functions without running it."""
