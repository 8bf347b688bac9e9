"""Passes that compute less for the same numbers."""
