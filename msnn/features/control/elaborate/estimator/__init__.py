"""Lowers the `estimator` section: a spec to the problem of its estimator."""
