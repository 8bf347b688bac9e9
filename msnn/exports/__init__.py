"""Writes exports and describes them."""
