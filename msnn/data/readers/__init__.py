"""Readers of binary formats: one module a format, loaded when a file of it is read."""
