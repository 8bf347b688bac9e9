"""Trains with second-order methods, with residuals and Jacobians from any engine."""
