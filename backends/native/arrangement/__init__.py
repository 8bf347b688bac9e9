"""Splits the computation of a kernel into phases, and groups sums."""
