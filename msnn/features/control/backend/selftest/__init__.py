"""Writes the self-test of a controller and the golden solves that it repeats."""
