"""Writes moving-horizon estimators as self-contained C."""

from msnn.features.control.backend.moving_horizon.write_horizon import horizon_texts

__all__ = ["horizon_texts"]
