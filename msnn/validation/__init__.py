"""Scores a model on data."""
