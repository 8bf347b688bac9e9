"""Optimal control problems and the predictive controller."""
