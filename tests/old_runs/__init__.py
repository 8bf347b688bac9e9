"""Runs of older versions of msnn, and what they compute."""
