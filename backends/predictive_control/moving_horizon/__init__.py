"""Writes moving-horizon estimators as self-contained C."""

from backends.predictive_control.moving_horizon.write_horizon import write_horizon

__all__ = ["write_horizon"]
