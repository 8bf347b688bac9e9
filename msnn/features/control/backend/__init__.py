"""Writes controllers, Kalman filters and moving-horizon estimators as self-contained C."""

from msnn.features.control.backend.write_controller import write_controller

__all__ = ["write_controller"]
