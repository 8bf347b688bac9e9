"""Kalman filters in numpy: the reference of generated filters, and the estimator in Python."""
