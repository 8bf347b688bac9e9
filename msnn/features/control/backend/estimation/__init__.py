"""Writes extended Kalman filters as self-contained C."""

from msnn.features.control.backend.estimation.write_filter import filter_texts

__all__ = ["filter_texts"]
