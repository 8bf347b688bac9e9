"""Remembers what lowering finds on its way."""
