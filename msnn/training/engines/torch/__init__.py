"""Trains by torch modules."""
