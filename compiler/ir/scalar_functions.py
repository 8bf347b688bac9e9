"""Every scalar function of the language, one row each: meaning, derivative, units, spellings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from compiler.kernels.definitions import (
    by_kernel,
    hyperbolic_cosine,
    hyperbolic_sine,
    inverse,
    logistic,
    one_minus_square,
    one_plus_square,
    slope_product,
    soft_plus,
    sum_of_squares,
    tangent,
)

if TYPE_CHECKING:
    from compiler.ir.builder import GraphBuilder
    from compiler.ir.program import NodeId

Array = NDArray[Any]
Derivative = Callable[["GraphBuilder", "tuple[NodeId, ...]", "NodeId"], "NodeId"]
Definition = Callable[["GraphBuilder", "tuple[NodeId, ...]"], "NodeId"]


class UnitRule(Enum):
    """How the unit of a function's value follows from those of its arguments."""

    NUMBER = "a dimensionless argument gives a dimensionless value"
    ANGLE = "an angle in rad gives a dimensionless value"
    TO_ANGLE = "a dimensionless argument gives rad"
    RATIO_TO_ANGLE = "two arguments of one unit give rad"
    SAME = "the value has the argument's unit"
    SIGN = "any argument gives a dimensionless value"
    ROOT = "the value has the square root of the argument's unit"


@dataclass(frozen=True, slots=True)
class ScalarFunction:
    """One row.

    `onnx` is None where onnxruntime has no exact double kernel, a spelling is empty where the
    backend has none: there `definition` is lowered instead. `kernel` names the project's own kernel
    for float32 and C; None means that the function is exact as it is (one IEEE operation).
    `domain` is where tests draw their samples, an interval an argument.
    """

    name: str
    numpy: Callable[..., Array]
    derivatives: tuple[Derivative, ...]
    """∂f/∂argument for each argument, from the builder, the arguments and the value."""
    units: UnitRule
    torch: str
    casadi: str
    onnx: str | None
    kernel: str | None
    definition: Definition | None
    domain: tuple[tuple[float, float], ...]
    doc: str

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
        "sin", np.sin, (lambda b, a, v: b.apply("cos", a[0]),),
        _ANGLE, "sin", "sin", "Sin", "sin", None, ((-100.0, 100.0),),
        "Sine of an angle in rad.",
    ),
    ScalarFunction(
        "cos", np.cos, (lambda b, a, v: b.negate(b.apply("sin", a[0])),),
        _ANGLE, "cos", "cos", "Cos", "cos", None, ((-100.0, 100.0),),
        "Cosine of an angle in rad.",
    ),
    ScalarFunction(
        "tan", np.tan, (lambda b, a, v: one_plus_square(b, v),),
        _ANGLE, "tan", "tan", None, "tan", tangent, ((-1.5, 1.5),),
        "Tangent of an angle in rad.",
    ),
    ScalarFunction(
        "asin", np.arcsin,
        (lambda b, a, v: inverse(b, b.apply("sqrt", one_minus_square(b, a[0]))),),
        _TO_ANGLE, "asin", "asin", None, "asin", by_kernel("asin"), ((-0.99, 0.99),),
        "Arc sine in rad, −π/2 … π/2.",
    ),
    ScalarFunction(
        "acos", np.arccos,
        (lambda b, a, v: b.negate(inverse(b, b.apply("sqrt", one_minus_square(b, a[0])))),),
        _TO_ANGLE, "acos", "acos", None, "acos", by_kernel("acos"), ((-0.99, 0.99),),
        "Arc cosine in rad, 0 … π.",
    ),
    ScalarFunction(
        "atan", np.arctan, (lambda b, a, v: inverse(b, one_plus_square(b, a[0])),),
        _TO_ANGLE, "atan", "atan", None, "atan", by_kernel("atan"), ((-50.0, 50.0),),
        "Arc tangent in rad, −π/2 … π/2.",
    ),
    ScalarFunction(
        "atan2", np.arctan2,
        (
            lambda b, a, v: b.divide(a[1], sum_of_squares(b, a)),
            lambda b, a, v: b.negate(b.divide(a[0], sum_of_squares(b, a))),
        ),
        UnitRule.RATIO_TO_ANGLE, "atan2", "atan2", None, "atan2", by_kernel("atan2"),
        ((-5.0, 5.0), (-5.0, 5.0)),
        "Angle of the point (x, y) = (second, first) in rad, −π … π.",
    ),
    ScalarFunction(
        "sinh", np.sinh, (lambda b, a, v: b.apply("cosh", a[0]),),
        _NUMBER, "sinh", "sinh", None, "sinh", hyperbolic_sine, ((-10.0, 10.0),),
        "Hyperbolic sine.",
    ),
    ScalarFunction(
        "cosh", np.cosh, (lambda b, a, v: b.apply("sinh", a[0]),),
        _NUMBER, "cosh", "cosh", None, "cosh", hyperbolic_cosine, ((-10.0, 10.0),),
        "Hyperbolic cosine.",
    ),
    ScalarFunction(
        "tanh", np.tanh, (lambda b, a, v: one_minus_square(b, v),),
        _NUMBER, "tanh", "tanh", "Tanh", "tanh", None, _WIDE,
        "Hyperbolic tangent.",
    ),
    ScalarFunction(
        "exp", np.exp, (lambda b, a, v: v,),
        _NUMBER, "exp", "exp", "Exp", "exp", None, ((-20.0, 20.0),),
        "Exponential.",
    ),
    ScalarFunction(
        "log", np.log, (lambda b, a, v: inverse(b, a[0]),),
        _NUMBER, "log", "log", "Log", "log", None, ((1e-3, 1e3),),
        "Natural logarithm; NaN below 0.",
    ),
    ScalarFunction(
        "sqrt", np.sqrt, (lambda b, a, v: b.divide(b.constant(0.5), v),),
        UnitRule.ROOT, "sqrt", "sqrt", "Sqrt", None, None, ((1e-3, 1e3),),
        "Square root; NaN below 0.",
    ),
    ScalarFunction(
        "abs", np.abs, (lambda b, a, v: b.apply("sign", a[0]),),
        UnitRule.SAME, "abs", "fabs", "Abs", None, None, _WIDE,
        "Magnitude; slope 0 at 0.",
    ),
    ScalarFunction(
        "sign", np.sign, (lambda b, a, v: b.multiply(b.constant(0.0), a[0]),),
        UnitRule.SIGN, "sign", "sign", "Sign", None, None, _WIDE,
        "−1, 0 or 1; slope 0 everywhere.",
    ),
    ScalarFunction(
        "sigmoid", _sigmoid, (lambda b, a, v: b.multiply(v, b.subtract(b.constant(1.0), v)),),
        _NUMBER, "sigmoid", "", None, "sigmoid", logistic, _WIDE,
        "1 / (1 + exp(−x)).",
    ),
    ScalarFunction(
        "softplus", _softplus, (lambda b, a, v: b.apply("sigmoid", a[0]),),
        _NUMBER, "", "", None, "softplus", soft_plus, _WIDE,
        "log(1 + exp(x)), smooth max(x, 0).",
    ),
    ScalarFunction(
        "pow", np.power,
        (
            lambda b, a, v: slope_product(
                b, a[1], b.apply("pow", a[0], b.subtract(a[1], b.constant(1.0)))
            ),
            lambda b, a, v: slope_product(b, v, b.apply("log", a[0])),
        ),
        _NUMBER, "pow", "power", "Pow", "pow", None, ((0.1, 10.0), (-3.0, 3.0)),
        "x to a real power; NaN for a negative x and a power that is no integer.",
    ),
)
# fmt: on

SCALAR_FUNCTIONS: dict[str, ScalarFunction] = {row.name: row for row in _ROWS}
"""The table by name."""
