"""Parses expressions into a tree and writes them as text."""
