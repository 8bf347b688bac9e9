"""Diagnostics: their contents and their formats."""
