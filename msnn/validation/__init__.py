"""Evaluates a model on data."""
