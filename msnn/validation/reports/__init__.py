"""Prints what a validation found."""
