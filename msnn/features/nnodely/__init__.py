"""Imports models saved by nnodely as specs and weights."""
