"""Independent values of the kernels, and errors in units in the last place."""

from collections.abc import Callable
from typing import Any

import numpy as np
from mpmath import mp, mpf
from numpy.typing import NDArray

Array = NDArray[Any]


def _sigmoid(x: Array) -> Array:
    small = np.exp(-np.abs(x))
    return np.where(x >= 0, 1.0, small) / (1.0 + small)


NUMPY: dict[str, Callable[..., Array]] = {
    **{name: getattr(np, name) for name in ("exp", "log", "sqrt", "sin", "cos", "tan")},
    **{name: getattr(np, name) for name in ("sinh", "cosh", "tanh")},
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "sigmoid": _sigmoid,
    "softplus": lambda x: np.maximum(x, 0.0) + np.log1p(np.exp(-np.abs(x))),
    "pow": np.power,
}

EXACT: dict[str, Callable[..., Any]] = {
    **{name: getattr(mp, name) for name in NUMPY if hasattr(mp, name)},
    "sigmoid": lambda x: 1 / (1 + mp.exp(-x)),
    "softplus": lambda x: mp.log1p(mp.exp(x)),
    "pow": mp.power,
}


def float_errors(values: Array, exact: Array) -> Array:
    """|values − exact| in units of the last place of float32, exact in float64 and finite."""
    _, exponent = np.frexp(exact)
    unit = np.ldexp(1.0, np.maximum(exponent - 1, -126) - 23)
    return np.abs(values.astype(np.float64) - exact) / unit


def double_error(value: float, exact: Any) -> float:
    """|value − exact| in units of the last place of float64."""
    exponent = max(mp.frexp(exact)[1] - 1, -1022)
    return float(abs(mpf(value) - exact) / mpf(2) ** (exponent - 52))
