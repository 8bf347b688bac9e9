"""Reads models that nnodely saved and writes them as specs and weights."""
