"""Diagnostics of measured data and their files."""
