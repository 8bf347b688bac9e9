"""Trains with torch modules."""
