"""Makes the predictive controller and the estimator of a model with its weights."""

from __future__ import annotations

from collections.abc import Mapping

from compiler.optimal_control.trained import trained
from msnn.control.controller import Controller
from msnn.control.kalman_filter import KalmanFilter
from msnn.data.dataset import FloatArray
from msnn.model.model import Model


def open_controller(model: Model, weights: Mapping[str, FloatArray]) -> Controller:
    """The controller of the model's `mpc` section. ValueError where it has none."""
    if model.control is None:
        raise ValueError(f"the spec of `{model.name}` has no `mpc` section")
    known = {parameter.name for parameter in model.control.program.parameters}
    return Controller(trained(model.control, {n: w for n, w in weights.items() if n in known}))


def open_estimator(model: Model, weights: Mapping[str, FloatArray]) -> KalmanFilter:
    """The filter of the model's `estimator` section. ValueError where it has none."""
    if model.estimation is None:
        raise ValueError(f"the spec of `{model.name}` has no `estimator` section")
    return KalmanFilter(model.estimation, weights)
