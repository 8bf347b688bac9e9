"""Writes moving-horizon estimators as self-contained C."""

from backends.predictive_control.moving_horizon.write_horizon import horizon_texts

__all__ = ["horizon_texts"]
