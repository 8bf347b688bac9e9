"""Solves optimal control problems: the predictive controller in Python."""
