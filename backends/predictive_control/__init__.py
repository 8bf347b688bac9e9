"""Writes predictive controllers as self-contained C."""

from backends.predictive_control.write_controller import write_controller

__all__ = ["write_controller"]
