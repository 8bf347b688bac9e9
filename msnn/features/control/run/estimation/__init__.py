"""Estimates states by windows of samples, with the solvers of controllers."""
