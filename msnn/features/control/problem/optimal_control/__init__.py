"""Holds the optimal control problem of a predictive controller as data."""
