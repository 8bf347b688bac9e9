"""Writes Kalman filters as self-contained C."""

from backends.predictive_control.estimation.write_filter import filter_texts

__all__ = ["filter_texts"]
