"""Writes Kalman filters as self-contained C."""

from backends.predictive_control.estimation.write_filter import write_filter

__all__ = ["write_filter"]
