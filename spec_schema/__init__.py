"""Reads what a user may write: text to Spec, each thing with its place in the file."""
