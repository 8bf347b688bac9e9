"""Compares two models, or two runs: what they exchange with others, and how well they predict."""
