"""Holds what an estimator of states and parameters is made of, as data."""
