"""Diagnostics of exports, and of what is brought in from other tools."""
