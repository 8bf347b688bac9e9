"""Joins sub-models: what feeds their inputs, and which of them a value needs."""
