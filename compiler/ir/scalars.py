"""The table of the scalar functions of the language: numpy implementation, derivatives, unit rule,
and names in the backends.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from compiler.ir import slopes
from compiler.ir.slopes import (
    Arithmetic,
    V,
    hyperbolic_cosine,
    hyperbolic_sine,
    logistic,
    soft_plus,
    tangent,
)
from spec_schema.expressions.language import (
    BUILTINS,
    LOSS_FUNCTIONS,
    NUMBERS,
    STATE_FUNCTIONS,
    TIME_NAMES,
    Signature,
)
from spec_schema.late_dataclass import dataclass

Array = NDArray[Any]


class Derivative(Protocol):
    """∂f/∂(one argument) of a scalar function f, from its arguments `a` and its value `v`. `b` does
    the arithmetic: by adding nodes to a graph, or on numbers.
    """

    def __call__(self, b: Arithmetic[V], a: tuple[V, ...], v: V, /) -> V: ...


class Curvatures(Protocol):
    """∂²f/∂x², ∂²f/∂x∂y and ∂²f/∂y² of a function of two arguments x, y = `a` with the value `v`.
    `b` does the arithmetic: by adding nodes to a graph, or on numbers.
    """

    def __call__(self, b: Arithmetic[V], a: tuple[V, ...], v: V, /) -> tuple[V, V, V]: ...


class FormulaOf(Protocol):
    """A function of the arguments `a`, expressed by other functions. `b` does the arithmetic: by
    adding nodes to a graph, or on numbers.
    """

    def __call__(self, b: Arithmetic[V], a: tuple[V, ...], /) -> V: ...


@dataclass(frozen=True, slots=True)
class ByFormula:
    """Defines a scalar function by a formula of other functions."""

    formula: FormulaOf


@dataclass(frozen=True, slots=True)
class ByKernel:
    """Defines a scalar function by the math kernel of this name, expanded into core operations."""

    name: str


Definition = ByFormula | ByKernel


class UnitRule(Enum):
    """The rule that gives the unit of a function's value from the units of its arguments."""

    NUMBER = "a dimensionless argument gives a dimensionless value"
    ANGLE = "an angle in rad gives a dimensionless value"
    TO_ANGLE = "a dimensionless argument gives rad"
    RATIO_TO_ANGLE = "two arguments of one unit give rad"
    SAME = "the value has the argument's unit"
    SIGN = "any argument gives a dimensionless value"
    ROOT = "the value has the square root of the argument's unit"


@dataclass(frozen=True, slots=True)
class ScalarFunction:
    """One scalar function of the language, and its name in each backend.

    `onnx` is None if onnxruntime has no exact double kernel. An empty `torch` or `casadi` means
    that the backend lacks the function. `definition` is lowered instead. `kernel` names the math
    kernel for float32 and C; None means that the function is exact as it is (one IEEE operation).
    `domain` is the sampling range of tests, one interval per argument.
    """

    name: str
    numpy: Callable[..., Array]
    derivatives: tuple[Derivative, ...]
    """One partial derivative per argument."""
    units: UnitRule
    torch: str
    casadi: str
    onnx: str | None
    kernel: str | None
    definition: Definition | None
    domain: tuple[tuple[float, float], ...]
    doc: str
    curvatures: Curvatures | None = None
    """Second derivatives, if differentiating `derivatives` would give wrong ones."""

    @property
    def arity(self) -> int:
        return len(self.derivatives)


def _sigmoid(x: Array) -> Array:
    # exp of a negative argument only, so that no intermediate overflows
    small = np.exp(-np.abs(x))
    return np.where(x >= 0, 1 / (1 + small), small / (1 + small))


def _softplus(x: Array) -> Array:
    return np.maximum(x, 0) + np.log1p(np.exp(-np.abs(x)))


_NUMBER, _ANGLE, _TO_ANGLE = UnitRule.NUMBER, UnitRule.ANGLE, UnitRule.TO_ANGLE
_WIDE = ((-30.0, 30.0),)

# name, numpy, derivatives, units, torch, casadi, onnx, kernel, definition, domain, doc
# fmt: off
_ROWS = (
    ScalarFunction(
        "sin", np.sin, (slopes.of_sine,),
        _ANGLE, "sin", "sin", "Sin", "sin", None, ((-100.0, 100.0),),
        "Sine of an angle in rad.",
    ),
    ScalarFunction(
        "cos", np.cos, (slopes.of_cosine,),
        _ANGLE, "cos", "cos", "Cos", "cos", None, ((-100.0, 100.0),),
        "Cosine of an angle in rad.",
    ),
    ScalarFunction(
        "tan", np.tan, (slopes.of_tangent,),
        _ANGLE, "tan", "tan", None, "tan", ByFormula(tangent), ((-1.5, 1.5),),
        "Tangent of an angle in rad.",
    ),
    ScalarFunction(
        "asin", np.arcsin,
        (slopes.of_arc_sine,),
        _TO_ANGLE, "asin", "asin", None, "asin", ByKernel("asin"), ((-0.99, 0.99),),
        "Arc sine in rad, −π/2 … π/2.",
    ),
    ScalarFunction(
        "acos", np.arccos,
        (slopes.of_arc_cosine,),
        _TO_ANGLE, "acos", "acos", None, "acos", ByKernel("acos"), ((-0.99, 0.99),),
        "Arc cosine in rad, 0 … π.",
    ),
    ScalarFunction(
        "atan", np.arctan, (slopes.of_arc_tangent,),
        _TO_ANGLE, "atan", "atan", None, "atan", ByKernel("atan"), ((-50.0, 50.0),),
        "Arc tangent in rad, −π/2 … π/2.",
    ),
    ScalarFunction(
        "atan2", np.arctan2,
        (
            slopes.of_angle_in_y,
            slopes.of_angle_in_x,
        ),
        UnitRule.RATIO_TO_ANGLE, "atan2", "atan2", None, "atan2", ByKernel("atan2"),
        ((-5.0, 5.0), (-5.0, 5.0)),
        "Angle of the point (x, y) = (second, first) in rad, −π … π.",
    ),
    ScalarFunction(
        "sinh", np.sinh, (slopes.of_hyperbolic_sine,),
        _NUMBER, "sinh", "sinh", None, "sinh", ByFormula(hyperbolic_sine), ((-10.0, 10.0),),
        "Hyperbolic sine.",
    ),
    ScalarFunction(
        "cosh", np.cosh, (slopes.of_hyperbolic_cosine,),
        _NUMBER, "cosh", "cosh", None, "cosh", ByFormula(hyperbolic_cosine), ((-10.0, 10.0),),
        "Hyperbolic cosine.",
    ),
    ScalarFunction(
        "tanh", np.tanh, (slopes.of_hyperbolic_tangent,),
        _NUMBER, "tanh", "tanh", "Tanh", "tanh", None, _WIDE,
        "Hyperbolic tangent.",
    ),
    ScalarFunction(
        "exp", np.exp, (slopes.of_exponential,),
        _NUMBER, "exp", "exp", "Exp", "exp", None, ((-20.0, 20.0),),
        "Exponential.",
    ),
    ScalarFunction(
        "log", np.log, (slopes.of_logarithm,),
        _NUMBER, "log", "log", "Log", "log", None, ((1e-3, 1e3),),
        "Natural logarithm; NaN below 0.",
    ),
    ScalarFunction(
        "sqrt", np.sqrt, (slopes.of_square_root,),
        UnitRule.ROOT, "sqrt", "sqrt", "Sqrt", None, None, ((1e-3, 1e3),),
        "Square root; NaN below 0.",
    ),
    ScalarFunction(
        "abs", np.abs, (slopes.of_magnitude,),
        UnitRule.SAME, "abs", "fabs", "Abs", None, None, _WIDE,
        "Magnitude; slope 0 at 0.",
    ),
    ScalarFunction(
        "sign", np.sign, (slopes.of_sign,),
        UnitRule.SIGN, "sign", "sign", "Sign", None, None, _WIDE,
        "−1, 0 or 1; slope 0 everywhere.",
    ),
    ScalarFunction(
        "sigmoid", _sigmoid, (slopes.of_logistic,),
        _NUMBER, "sigmoid", "", None, "sigmoid", ByFormula(logistic), _WIDE,
        "1 / (1 + exp(−x)).",
    ),
    ScalarFunction(
        "softplus", _softplus, (slopes.of_soft_plus,),
        UnitRule.SAME, "", "", None, "softplus", ByFormula(soft_plus), _WIDE,
        "log(1 + exp(x)), smooth max(x, 0), in the unit of x.",
    ),
    ScalarFunction(
        "pow", np.power,
        (
            slopes.of_power_in_base,
            slopes.of_power_in_exponent,
        ),
        _NUMBER, "pow", "power", "Pow", "pow", None, ((0.1, 10.0), (-3.0, 3.0)),
        "x to a real power; NaN for a negative x and a power that is no integer.",
        slopes.curvatures_of_power,
    ),
)
# fmt: on

SCALAR_FUNCTIONS: dict[str, ScalarFunction] = {row.name: row for row in _ROWS}
"""The table of scalar functions, by name."""


SIGNATURES: dict[str, Signature] = {
    row.name: Signature(row.arity, row.arity, doc=row.doc) for row in SCALAR_FUNCTIONS.values()
} | BUILTINS
"""Every builtin function by name."""

OF_THE_LANGUAGE = frozenset({*TIME_NAMES, *NUMBERS, *STATE_FUNCTIONS, *SIGNATURES, *LOSS_FUNCTIONS})
"""Names with a fixed meaning in every spec, unless the spec declares them itself."""
